import importlib.util
import json
import sys

import numpy as np
import pytest

from interop import sofa_stub
from mixpinn.base.errors import InputError
from mixpinn.interop import SofaSettings, export_sofa_scene, read_sofa_recording
from mixpinn.records import Probe, ProbePath, TissueMesh

PROBE = Probe(np.array([[-2, 0, -2], [2, 0, -2], [0, 0, 3.0]]), np.array([[0, 1, 2]]))


def two_cells(tissues=1):
    """Two tetrahedra whose shared face is soft on one node only; nodes 0, 1, 2 form a rigid part."""
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 0, 10], [3, 10, 3], [3, -10, 3.0]])
    cells = np.array([[0, 2, 1, 3], [0, 1, 2, 4]], dtype=np.int32)
    return TissueMesh(
        points, cells, np.array([1, 1, 1, 0, 0], dtype=np.int16), np.array([0, 0, 0, 0, 1], dtype=bool), ("L1",),
        np.arange(2, dtype=np.int16) % tissues, tuple(f"tissue {i}" for i in range(tissues)),
    )


def path_down(steps=3, x=3.0):
    translations = np.array([[x, 13.0 - step, 3.0] for step in range(steps)])
    return ProbePath(translations, np.tile(np.eye(3), (steps, 1, 1)), np.arange(1.0, steps + 1))


PATHS = {(0, 0.0): path_down(), (1, 90.0): path_down(x=4.0)}
SKIN = np.array([[0, 2, 3]])


def load(scene, monkeypatch, animate=lambda root: None):
    for name, module in sofa_stub.modules(animate).items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("exported_scene", scene)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_everything_that_the_scene_reads_is_written(tmp_path):
    scene = export_sofa_scene(tmp_path, two_cells(), PROBE, PATHS, skin_faces=SKIN)
    assert {path.name for path in tmp_path.iterdir()} == {
        "scene.py", "parameters.json", "geometry.npz", "paths.npz", "body.vtu", "probe.stl",
    }
    text = scene.read_text()
    compile(text, "scene.py", "exec")
    assert "Mesh of 5 nodes and 2 tetrahedra; rigid parts: L1" in text
    assert "{{" not in text
    assert json.loads((tmp_path / "parameters.json").read_text())["mu"] == [8.758621e-3]
    assert TissueMesh.load(tmp_path / "body.vtu").hash() == two_cells().hash()


def test_scene_holds_the_set_up(tmp_path, monkeypatch):
    module = load(export_sofa_scene(tmp_path, two_cells(), PROBE, PATHS, skin_faces=SKIN), monkeypatch)
    root = sofa_stub.Node("root")
    module.build(root, 1)
    law, = root.find("TetrahedronHyperelasticityFEMForceField")
    assert law.settings["materialName"] == "StableNeoHookean"
    assert [float(text) for text in law.settings["ParameterSet"].split()] == [8.758621e-3, 84.666667e-3]
    contact, = root.find("LocalMinDistance")
    assert (contact.settings["alarmDistance"], contact.settings["contactDistance"]) == (4.0, 2.0)
    assert root.find("CollisionResponse")[0].settings["responseParams"] == "mu=1.0"
    fixed, = root.find("FixedProjectiveConstraint")
    assert fixed.settings["indices"] == [1]  # node 4 is the second soft node
    mapping, = root.find("SubsetMultiMapping")
    assert mapping.settings["indexPairs"] == [[1, 0], [1, 1], [1, 2], [0, 0], [0, 1]]
    assert mapping.settings["input"] == ["@/root/body/soft/dofs", "@/root/body/rigid/points/dofs"]
    frames, = (item for item in root.find("MechanicalObject") if item.settings["template"] == "Rigid3d")
    np.testing.assert_allclose(frames.settings["position"], [[10 / 3, 0, 10 / 3, 0, 0, 0, 1]])
    assert root.find("RigidMapping")[0].settings["rigidIndexPerPoint"] == [0, 0, 0]
    kinds = root.kinds()
    for kind in (
        "FreeMotionAnimationLoop", "SparseLDLSolver", "GenericConstraintCorrection", "CollisionPipeline",
        "TetrahedronSetTopologyContainer", "MeshMatrixMass", "SubsetMapping",
    ):
        assert kinds.count(kind) == 1, kind
    assert kinds.count("TriangleCollisionModel") == 2


def test_scene_without_rigid_parts_and_with_two_tissues(tmp_path, monkeypatch):
    mesh = two_cells(tissues=2)
    soft = TissueMesh(
        mesh.points, mesh.cells, np.zeros(5, dtype=np.int16), mesh.fixed, (), mesh.tissue, mesh.tissue_names,
    )
    settings = SofaSettings(mu=(0.01, 0.02), lam=(0.1, 0.2))
    module = load(export_sofa_scene(tmp_path, soft, PROBE, PATHS, settings=settings, skin_faces=SKIN), monkeypatch)
    root = sofa_stub.Node("root")
    module.build(root, 0)
    assert [law.settings["ParameterSet"] for law in root.find("TetrahedronHyperelasticityFEMForceField")] == [
        "0.01 0.1", "0.02 0.2",
    ]
    assert not root.find("RigidMapping")
    assert root.find("SubsetMultiMapping")[0].settings["indexPairs"] == [[0, i] for i in range(5)]


@pytest.mark.parametrize("hold", [0, 2])
def test_recording_of_the_scene_is_what_the_import_reads(tmp_path, monkeypatch, hold):
    """The stand-in for SOFA moves node 3 down by 0.5 mm a frame and presses it with 2 N from the second step."""
    mesh, frames = two_cells(), []

    def animate(root):
        tissue = next(item for item in root.all() if getattr(item, "path", "") == "/root/body/soft/tissue/dofs")
        probe = next(item for item in root.all() if getattr(item, "path", "") == "/root/probe/dofs")
        frames.append(float(np.array(probe.data["position"].value)[:, 1].mean()))
        tissue.data["position"].value = np.array(tissue.data["position"].value) + 0.0
        tissue.data["position"].value[3, 1] -= 0.5
        if frames[-1] < 12.5:
            tissue.data["lambda"].value = np.zeros((5, 3))
            tissue.data["lambda"].value[3, 1] = -2.0 * 0.05
            tissue.data["constraint"].value = "0 2 3 0 1 0 0 0 0 0\n1 1 3 1 0 0\n"

    settings = SofaSettings(hold_frames=hold)
    scene = export_sofa_scene(tmp_path, mesh, PROBE, PATHS, settings=settings, skin_faces=SKIN)
    module = load(scene, monkeypatch, animate)
    target = module.record_pose(1, tmp_path / "recordings")
    assert target.name == "pose_001_090.npz"
    assert frames == [13.0 - step for step in range(3) for _ in range(1 + hold)]
    simulation = read_sofa_recording(target, mesh)
    path = PATHS[1, 90.0]
    assert (simulation.position_index, simulation.rotation_deg) == (1, 90.0)
    np.testing.assert_allclose(simulation.path.translations, path.translations)
    np.testing.assert_allclose(simulation.path.rotations, path.rotations)
    np.testing.assert_array_equal(simulation.path.depths, path.depths)
    moved = [-0.5 * (1 + hold) * step for step in (1, 2, 3)]
    np.testing.assert_allclose(simulation.displacement[:, 3, 1], moved, atol=1e-6)
    assert simulation.contacts(0, loaded=False)[0].tolist() == []
    for step in (1, 2):
        assert simulation.contacts(step, loaded=False)[0].tolist() == [0, 3]
        nodes, forces = simulation.contacts(step)
        assert nodes.tolist() == [3]
        np.testing.assert_allclose(forces, [[0.0, -2.0, 0.0]], rtol=1e-6)
    assert simulation.sample_steps().tolist() == [1, 2]


def test_constrained_nodes_from_a_sparse_matrix(tmp_path, monkeypatch):
    from scipy.sparse import csr_matrix

    module = load(export_sofa_scene(tmp_path, two_cells(), PROBE, PATHS, skin_faces=SKIN), monkeypatch)
    matrix = np.zeros((2, 15))
    matrix[0, 4], matrix[1, 12] = 1.0, 0.5
    force = np.zeros((5, 3))
    force[2, 1] = 1.0
    assert module.constrained_nodes(csr_matrix(matrix), force).tolist() == [1, 2, 4]


def test_default_skin_is_what_the_probe_can_reach(tmp_path):
    """Two pairs of cells far apart: only the upper faces of the near pair are kept."""
    near = two_cells()
    points = np.vstack([near.points, near.points + np.array([500.0, 0.0, 0.0])])
    cells = np.vstack([near.cells, near.cells + 5])
    mesh = TissueMesh(
        points, cells.astype(np.int32), np.zeros(10, dtype=np.int16), np.zeros(10, dtype=bool), (),
        np.zeros(4, dtype=np.int16),
    )
    export_sofa_scene(tmp_path, mesh, PROBE, PATHS)
    faces = np.load(tmp_path / "geometry.npz")["skin_faces"]
    assert {tuple(sorted(face)) for face in faces.tolist()} <= {(0, 1, 3), (0, 2, 3), (1, 2, 3)}
    assert len(faces)
    corners = points[faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 1] > 0.0).all()


def test_exports_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(InputError, match="one length"):
        export_sofa_scene(tmp_path, two_cells(), PROBE, {(0, 0.0): path_down(2), (1, 0.0): path_down(3)})
    with pytest.raises(InputError, match="one length"):
        export_sofa_scene(tmp_path, two_cells(), PROBE, {})
    with pytest.raises(InputError, match="mu, lam"):
        export_sofa_scene(tmp_path, two_cells(), PROBE, PATHS, settings=SofaSettings(mu=(1.0, 2.0), lam=(1.0, 2.0)))


def test_quadratic_cells_are_refused(tmp_path):
    with pytest.raises(InputError, match="linear cells"):
        export_sofa_scene(tmp_path, two_cells().with_order(2), PROBE, PATHS, skin_faces=SKIN)
