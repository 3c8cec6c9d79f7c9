"""The tissue of cells: pure and mixed, next to bone and outside; thin layers keep their volume."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import block
from mesh.shapes import ball_label_map
from mixpinn.anatomy.mixture import mixed_parts, mixture_name
from mixpinn.base.errors import InputError
from mixpinn.fem import LinearElastic, StableNeoHookean
from mixpinn.fem.material.mixed import mean_material
from mixpinn.fem.material.tissue_presets import TissuePreset, preset_modulus
from mixpinn.mesh.cells.tissues import cell_tissues, tissue_table, tissue_volumes
from mixpinn.records.label_map import LabelMap
from mixpinn.stages.simulation import SimulationConfig, TissueConfig, make_scene

CORNERS = np.array([[0.0, 0, 0], [3.0, 0, 0], [0, 3.0, 0], [0, 0, 3.0]])


def halves() -> LabelMap:
    """Muscle where x < 0, a ball of bone in the middle."""
    label_map = ball_label_map()
    labels = label_map.labels.copy()
    labels[labels == 2] = 3
    left = labels[: labels.shape[0] // 2]
    left[left == 1] = 2
    return replace(label_map, labels=labels, soft_names=("body", "muscle"))


def test_cells_within_one_tissue_in_bone_and_outside() -> None:
    at = np.array([[-30.0, 0, 0], [30.0, 0, 0], [0.0, 0, 0], [500.0, 0, 0]])
    tissue, names = cell_tissues(at[:, None] + CORNERS, halves())
    np.testing.assert_array_equal(tissue, [1, 0, 0, 0])
    assert names == ("body", "muscle")


def sheet(thickness: float = 2.0) -> LabelMap:
    """A block of muscle of 60 mm with a sheet of fat across z, in voxels of 1 mm, and a margin of air."""
    labels = np.zeros((62, 62, 62), dtype=np.uint8)
    labels[1:-1, 1:-1, 1:-1] = 1
    labels[1:-1, 1:-1, 31:31 + round(thickness)] = 2
    affine = np.eye(4)
    affine[:3, 3] = -0.5
    return LabelMap(labels, affine, np.eye(4), ("muscle", "fat"), ())


@pytest.mark.parametrize("thickness", [2.0, 4.0, 7.0])
def test_a_sheet_thinner_than_the_cells_keeps_its_volume(thickness) -> None:
    """Cells of 15 mm; each is a tissue or a mixture in tenths, so that what is lost or won is the rounding's."""
    mesh = block((4, 4, 4), size=(60.0, 60.0, 60.0), shake=0.2)
    tissue, names = cell_tissues(mesh.points[mesh.cells], sheet(thickness))
    mesh = replace(mesh, tissue=tissue, tissue_names=names)
    volumes = tissue_volumes(mesh)
    assert sum(volumes.values()) == pytest.approx(60.0**3, rel=1e-9)
    assert volumes["fat"] == pytest.approx(3600.0 * thickness, rel=0.15)
    assert any(len(mixed_parts(name)) > 1 for name in names)
    assert f"| fat | {3.6e-3 * thickness:.2f} |" in tissue_table(mesh, sheet(thickness))


def test_a_half_has_one_name_whichever_comes_first() -> None:
    mesh = block((6, 6, 4), size=(60.0, 60.0, 60.0))
    tissue, names = cell_tissues(mesh.points[mesh.cells], sheet(7.0))
    assert len(set(names)) == len(names)
    assert set(np.unique(tissue)) <= set(range(len(names)))


def test_names_of_mixtures_are_read_back() -> None:
    assert mixed_parts(mixture_name("fat", "skeletal_muscle", 0.75)) == (("fat", 0.75), ("skeletal_muscle", 0.25))
    assert mixed_parts("fat") == (("fat", 1.0),)
    assert mixed_parts("fat 75 % + muscle 75 %") == (("fat 75 % + muscle 75 %", 1.0),)


def test_a_mixture_has_the_mean_moduli_of_its_tissues() -> None:
    mesh = block((1, 1, 1))
    mesh = replace(mesh, fixed=mesh.points[:, 1] == mesh.points[:, 1].min())
    name = mixture_name("fat", "muscle", 0.25)
    mesh = replace(mesh, tissue_names=("muscle", "fat", name))
    found = make_scene(mesh, SimulationConfig(moduli=TissuePreset.COMPRESSION)).materials
    fat, muscle = (preset_modulus(part, "compression").material() for part in ("fat", "muscle"))
    assert found[2].mu == pytest.approx(0.25 * fat.mu + 0.75 * muscle.mu)
    assert found[2].lam == pytest.approx(0.25 * fat.lam + 0.75 * muscle.lam)
    own = make_scene(mesh, SimulationConfig(tissues={"fat": TissueConfig(young=4.0)})).materials
    assert own[2].mu == pytest.approx(0.25 * own[1].mu + 0.75 * muscle.mu)
    only = make_scene(replace(mesh, tissue_names=("muscle", "muscle 2", name)), SimulationConfig(
        tissues={"fat": TissueConfig(young=4.0)},
    ))
    assert only.materials[2] == own[2]


def test_tissues_of_different_energies_have_no_mean() -> None:
    laws = StableNeoHookean.from_young(0.02, 0.4), LinearElastic.from_young(0.02, 0.4)
    with pytest.raises(InputError, match="one energy"):
        mean_material([(0.5, law) for law in laws])
