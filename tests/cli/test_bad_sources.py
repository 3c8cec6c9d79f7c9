"""Bad sources of data at the command line, from label maps to simulations: refused in one line."""

import shutil

import nibabel as nib
import numpy as np
import pytest
import pyvista as pv

from cli.refusal import refused
from mixpinn.records import LabelMap, TissueMesh
from mixpinn.stages.seal import seal_folder
from pipeline.chain import contents

SHAPE = (12, 11, 20)


def box(low, high):
    mask = np.zeros(SHAPE, dtype=np.uint8)
    mask[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))] = 1
    return mask


@pytest.fixture
def labels(tmp_path):
    """Writer of a folder with one NIfTI a structure, by default a sound one."""
    folder = tmp_path / "labels"
    folder.mkdir()

    def write(affine=None, **masks):
        sound = {
            "body_trunc": box((1, 1, 0), (10, 9, 19)), "vertebrae_L1": box((4, 4, 11), (7, 7, 13)),
            "vertebrae_L2": box((4, 4, 6), (7, 7, 8)),
        }
        for name, mask in {**sound, **masks}.items():
            matrix = np.diag([10.0, 10.0, 10.0, 1.0]) if affine is None else affine
            nib.save(nib.Nifti1Image(mask, matrix), folder / f"{name}.nii.gz")
        return folder

    return write


@pytest.fixture
def refuses_anatomy(tmp_path):
    def check(folder, says, *words):
        refused("anatomy", folder, "--out", tmp_path / "out", *words, says=says, out=tmp_path / "out")

    return check


class TestAnatomy:
    def test_missing_folder(self, tmp_path, refuses_anatomy):
        refuses_anatomy(tmp_path / "absent", ["absent", "no such file"])

    def test_missing_body(self, labels, refuses_anatomy):
        folder = labels()
        (folder / "body_trunc.nii.gz").unlink()
        refuses_anatomy(folder, ["body_trunc.nii.gz", "only vertebrae_L1"])

    def test_missing_structure(self, labels, refuses_anatomy):
        refuses_anatomy(labels(), "vertebrae_L9", "--rigid", "vertebrae_L1", "--rigid", "vertebrae_L9")

    def test_empty_structure(self, labels, refuses_anatomy):
        refuses_anatomy(labels(vertebrae_L2=np.zeros(SHAPE, np.uint8)), ["vertebrae_L2", "at least one voxel"])

    def test_different_grids(self, labels, refuses_anatomy):
        folder = labels()
        nib.save(nib.Nifti1Image(np.ones((5, 5, 5), np.uint8), np.eye(4)), folder / "vertebrae_L2.nii.gz")
        refuses_anatomy(folder, ["vertebrae_L2.nii.gz", "resample"])

    def test_vertebra_outside_the_body(self, labels, refuses_anatomy):
        refuses_anatomy(labels(body_trunc=box((1, 1, 0), (10, 9, 8))), ["vertebrae_L1", "outside"])

    def test_overlapping_labels(self, labels, refuses_anatomy):
        refuses_anatomy(labels(vertebrae_L2=box((4, 4, 9), (7, 7, 11))), ["vertebrae_L1 and vertebrae_L2", "shared"])

    def test_four_dimensions(self, labels, refuses_anatomy):
        refuses_anatomy(labels(vertebrae_L2=np.zeros((*SHAPE, 2), np.uint8)), ["vertebrae_L2.nii.gz", "4-D"])

    @pytest.mark.parametrize(("value", "says"), [(np.nan, "finite affine"), (0.0, "singular affine")])
    def test_bad_affine(self, labels, refuses_anatomy, value, says):
        folder = labels()
        image = nib.load(folder / "vertebrae_L1.nii.gz")
        image.header["srow_x"] = [value, 0, 0, 0]
        content = bytearray(image.header.binaryblock) + bytes(4) + np.asarray(image.dataobj).tobytes(order="F")
        content[254:256] = np.int16(1).tobytes()  # sform_code
        (folder / "vertebrae_L1.nii.gz").unlink()
        (folder / "vertebrae_L1.nii").write_bytes(bytes(content))
        refuses_anatomy(folder, ["vertebrae_L1.nii", says])

    def test_corrupt_file(self, labels, refuses_anatomy):
        path = labels() / "vertebrae_L1.nii.gz"
        path.write_bytes(path.read_bytes()[:-20])
        refuses_anatomy(path.parent, ["vertebrae_L1.nii.gz", "damaged"])

    def test_impossible_phantom(self, refuses_anatomy):
        refuses_anatomy("phantom", ["phantom.vertebrae", "99"], "--set", "phantom.vertebrae=99")


class TestMesh:
    @pytest.fixture
    def grid(self, chain):
        return TissueMesh.load(chain.mesh / "mesh.vtu").grid()

    @pytest.fixture
    def refuses_mesh(self, tmp_path):
        def check(grid, says, *words):
            grid.save(tmp_path / "given.vtu")
            refused("mesh", tmp_path / "given.vtu", "--out", tmp_path / "out", *words, says=says, out=tmp_path / "out")

        return check

    def test_cell_without_volume(self, grid, refuses_mesh):
        cells = grid.cells_dict[pv.CellType.TETRA]
        grid.points[cells[0, 0]] = grid.points[cells[0, 1:]].mean(axis=0)
        refuses_mesh(grid, "given.vtu")

    def test_inverted_cell(self, grid, refuses_mesh):
        cells = grid.cells_dict[pv.CellType.TETRA]
        corner = cells[0, 0]
        grid.points[corner] += 2.5 * (grid.points[cells[0, 1:]].mean(axis=0) - grid.points[corner])
        refuses_mesh(grid, "given.vtu")

    def test_unknown_part(self, grid, refuses_mesh):
        grid.point_data["part"][0] = 7
        refuses_mesh(grid, "unknown part labels [7]")

    def test_other_cells(self, refuses_mesh):
        refuses_mesh(pv.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid(), "tetrahedra")

    def test_fixed_nodes_of_another_mesh(self, grid, refuses_mesh, tmp_path):
        (tmp_path / "fixed.txt").write_text("0\n99999\n")
        refuses_mesh(grid, "99999", "--fixed", tmp_path / "fixed.txt")

    def test_damaged_mesh(self, chain, tmp_path):
        (tmp_path / "cut.vtu").write_bytes((chain.mesh / "mesh.vtu").read_bytes()[:2000])
        refused("mesh", tmp_path / "cut.vtu", "--out", tmp_path / "out", says="cut.vtu", out=tmp_path / "out")

    def test_damaged_label_map(self, chain, tmp_path):
        shutil.copytree(chain.anatomy, tmp_path / "a")
        path = tmp_path / "a" / "labels.nii.gz"
        path.write_bytes(path.read_bytes()[:-100])
        refused("mesh", tmp_path / "a", "--out", tmp_path / "out", says="labels.nii.gz", out=tmp_path / "out")

    def test_label_map_without_description(self, chain, tmp_path):
        shutil.copytree(chain.anatomy, tmp_path / "a")
        (tmp_path / "a" / "labels.json").write_text("{}")
        refused("mesh", tmp_path / "a", "--out", tmp_path / "out", says="labels.json", out=tmp_path / "out")
        (tmp_path / "a" / "labels.manifest.json").unlink()
        seal_folder(tmp_path / "a")
        refused("mesh", tmp_path / "a", "--out", tmp_path / "out", says="labels.json", out=tmp_path / "out")

    def test_label_map_that_cannot_be_meshed(self, chain, tmp_path):
        label_map = LabelMap.load(chain.anatomy / "labels.nii.gz")
        labels = np.zeros_like(label_map.labels)
        (tmp_path / "a").mkdir()
        LabelMap(
            labels, label_map.affine, label_map.world_to_scanner, label_map.soft_names, label_map.rigid_names,
        ).save(tmp_path / "a" / "labels.nii.gz")
        refused("mesh", tmp_path / "a", "--out", tmp_path / "out", says="body", out=tmp_path / "out")

    @pytest.mark.parametrize(("words", "says"), [
        (["--size", "0"], "size"), (["--mesher", "gmsh"], "'auto', 'cgal' or 'tetwild'"),
        (["--set", "sizing.cell_size=x"], "cell_size"),
    ])
    def test_bad_settings(self, chain, tmp_path, words, says):
        refused("mesh", chain.anatomy, "--out", tmp_path / "out", *words, says=says, out=tmp_path / "out")


class TestSimulate:
    @pytest.fixture
    def refuses(self, chain, tmp_path):
        def check(says, *words, out=tmp_path / "out", mesh=chain.mesh):
            settings = ["--config", chain.settings("simulate")]
            refused("simulate", mesh, *settings, "--out", tmp_path / "out", *words, says=says, out=out)

        return check

    def test_unreadable_probe(self, refuses, tmp_path):
        (tmp_path / "probe.stl").write_text("solid nothing")
        refuses("probe.stl", "--probe", tmp_path / "probe.stl")
        refuses("no such file", "--probe", tmp_path / "absent.stl")

    @pytest.mark.parametrize("text", ["0 1\n", "x y z\n", "", "0 nan 0\n"])
    def test_unreadable_positions(self, refuses, tmp_path, text):
        (tmp_path / "positions.txt").write_text(text)
        refuses(["positions.txt", "one 'x y z'"], "--positions", tmp_path / "positions.txt")

    def test_positions_beside_the_body(self, refuses, tmp_path):
        (tmp_path / "positions.txt").write_text("500 0 0\n")
        refuses("probe position", "--positions", tmp_path / "positions.txt")

    def test_probe_that_starts_inside_the_body(self, refuses, tmp_path):
        (tmp_path / "positions.txt").write_text("0 20 0\n0 10 5\n")
        refuses(
            ["outside the body", "2 failures"], "--positions", tmp_path / "positions.txt", "--set",
            "protocol.start=listed", out=None,
        )

    def test_unknown_tissue(self, refuses):
        refuses("'fat'", "--set", 'tissues={"fat": {"young": 5}}')

    def test_impossible_tissue(self, refuses):
        refuses("poisson", "--set", "tissue.poisson=0.6")
        refuses("both mu and lam", "--set", "tissue.mu=5")

    def test_unknown_setting_of_a_tissue(self, refuses):
        refuses("yung", "--set", 'tissues={"soft tissue": {"yung": 5}}')

    def test_unknown_protocol(self, refuses):
        refuses(["--protocol huge", "tiny"], "--protocol", "huge")

    def test_impossible_protocol(self, refuses):
        refuses("protocol.steps", "--set", "protocol.steps=0")

    def test_workers(self, refuses):
        refuses("workers", "--workers", "-1")

    def test_damaged_mesh(self, chain, refuses, tmp_path):
        (tmp_path / "cut.vtu").write_bytes((chain.mesh / "mesh.vtu").read_bytes()[:2000])
        refuses("cut.vtu", mesh=tmp_path / "cut.vtu")

    def test_foreign_mesh(self, refuses, tmp_path):
        pv.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid().save(tmp_path / "foreign.vtu")
        refuses("foreign.vtu", mesh=tmp_path / "foreign.vtu")

    def test_another_mesh_in_the_same_folder(self, chain, tmp_path):
        shutil.copytree(chain.simulation, tmp_path / "s")
        mesh = TissueMesh.load(chain.mesh / "mesh.vtu").grid()
        mesh.points[0] += 0.01
        mesh.save(tmp_path / "moved.vtu")
        before = contents(tmp_path / "s")
        refused(
            "simulate", tmp_path / "moved.vtu", "--config", chain.settings("simulate"), "--out", tmp_path / "s",
            says="another inputs",
        )
        assert contents(tmp_path / "s") == before


@pytest.mark.parametrize(("verb", "folder", "says"), [
    ("simulate", "anatomy", "expected the folder of a mesh, got one without mesh.vtu; run 'mixpinn mesh' first"),
    ("predict", "simulation", "expected a bundle or a trained network, got a folder without hybrid.json"),
])
def test_a_folder_of_another_stage_is_named(chain, tmp_path, verb, folder, says):
    more = ["--tip=0,0,0"] if verb == "predict" else []
    refused(verb, getattr(chain, folder), *more, "--out", tmp_path / "out.vtu", says=says)
