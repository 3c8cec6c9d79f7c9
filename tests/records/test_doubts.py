"""What was noticed about an anatomy stays with the label map, the mesh and whatever holds a copy of it."""

from dataclasses import replace

import numpy as np

from mixpinn.mesh import import_vtu
from mixpinn.records import LabelMap, TissueMesh
from mixpinn.records.doubts import in_short
from validation.kuhn import grid_points, kuhn_cells

DOUBTS = (
    "vertebrae_L1: cut off: 229 voxels at the image's border", "Körper: affine: sform and qform are 3 mm apart",
    "repaired: vertebrae_L4: order: swapped with vertebrae_L3",
)


def test_in_short():
    assert in_short(()) == ""
    assert in_short(DOUBTS) == "cut off (vertebrae_L1); affine (Körper); repaired (vertebrae_L4)"
    many = [f"rib_{k}: cut off: {k} voxels" for k in range(12)]
    assert in_short([*many, *many]) == "cut off (rib_0, rib_1, rib_2, rib_3 and 8 more)"
    assert in_short(["mesh: no node is fixed: nothing holds the body"]) == "no node is fixed (mesh)"


def test_a_label_map_keeps_its_doubts(tmp_path):
    plain = LabelMap(np.ones((2, 3, 4), dtype=np.uint8), np.eye(4), np.eye(4), ("body",), ())
    doubted = replace(plain, doubts=DOUBTS)
    doubted.save(tmp_path / "labels.nii.gz")
    assert LabelMap.load(tmp_path / "labels.nii.gz").doubts == DOUBTS
    assert plain.hash() == doubted.hash()


def test_a_mesh_keeps_its_doubts_and_is_the_same_mesh(tmp_path):
    points, cells = grid_points(*[np.arange(2.0)] * 3), kuhn_cells((1, 1, 1))
    plain = TissueMesh(
        points, cells, np.zeros(8, dtype=np.int16), np.zeros(8, dtype=bool), (), np.zeros(len(cells), dtype=np.int16),
    )
    doubted = replace(plain, doubts=DOUBTS)
    for name, mesh in (("plain", plain), ("doubted", doubted), ("quadratic", doubted.with_order(2))):
        mesh.save(tmp_path / f"{name}.vtu")
        found = TissueMesh.load(tmp_path / f"{name}.vtu")
        assert found.doubts == mesh.doubts
        assert found.hash() == mesh.hash()
    assert plain.hash() == doubted.hash()
    assert import_vtu(tmp_path / "doubted.vtu").doubts == DOUBTS
