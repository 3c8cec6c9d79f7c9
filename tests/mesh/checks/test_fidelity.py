import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.mesh import mesh_fidelity, voxel_parts
from mixpinn.mesh.checks.fidelity import dice
from mixpinn.records import LabelMap
from mixpinn.records.label_map import SCANNER_TO_WORLD

CAVITY = np.s_[1:3, 1:3, 1:2]


def box_labels(voxel=2.5, shift=0):
    """Voxels of the box of `box_mesh` with its cavity; `shift` moves the cavity by so many voxels along x."""
    n = int(40 / voxel)
    per = int(10 / voxel)
    labels = np.zeros((n + 4,) * 3, dtype=np.uint8)
    labels[2:-2, 2:-2, 2:-2] = 1
    x = slice(2 + per + shift, 2 + 3 * per + shift)
    labels[x, 2 + per:2 + 3 * per, 2 + per:2 + 2 * per] = 2
    affine = np.diag([voxel, voxel, voxel, 1.0])
    affine[:3, 3] = -20.0 - 1.5 * voxel
    return LabelMap(labels, affine, np.linalg.inv(SCANNER_TO_WORLD), ("body",), ("block",))


def test_voxels_of_a_box_are_exact():
    label_map = box_labels()
    expected = label_map.labels.astype(int)
    np.testing.assert_array_equal(voxel_parts(box_mesh(cavity=CAVITY), label_map), np.select(
        [expected == 0, expected == 2], [-1, 1], 0))


def test_shifted_cavity():
    """A block 8 voxels long, shifted by one, overlaps by 7/8; its ends lie one voxel apart.

    Marching cubes cut the corners of voxels off, by at most half a voxel's diagonal.
    """
    body, block = mesh_fidelity(box_mesh(cavity=CAVITY), box_labels(shift=1)).structures
    assert (body.name, block.name) == ("body", "block")
    assert body.dice == 1.0
    assert block.dice == pytest.approx(7 / 8)
    assert block.hausdorff_95 == pytest.approx(2.5, abs=0.05)
    assert 2.45 <= block.hausdorff <= np.hypot(2.5, np.sqrt(2.0) * 1.25) + 0.05


def test_dice_of_masks():
    first = np.array([True, True, False, False])
    assert dice(first, first) == 1.0
    assert dice(first, ~first) == 0.0
    assert dice(first, np.array([True, False, False, False])) == pytest.approx(2 / 3)
