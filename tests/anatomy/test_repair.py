import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anatomy.checks.test_labels import named
from mixpinn.anatomy import check, place_in_frame, repair
from mixpinn.base.errors import InputError

from .builders import SHAPE, block, full, masks, segmentation


def mended(structures, **kwargs):
    result, reports = repair(segmentation(structures, **kwargs))
    assert all(report.repaired for report in reports)
    return {s.name: full(s) for s in (result.body, *result.parts)}, {(r.kind, r.structure): r for r in reports}


def test_sound_anatomy_is_left_alone():
    after, reports = mended(masks())
    assert reports == {}
    for name, mask in masks().items():
        assert np.array_equal(after[name], mask)


def test_islands_and_holes():
    structures = masks()
    structures["vertebrae_L1"] |= block((4, 4, 16), (4, 4, 17))
    structures["vertebrae_L1"][5, 5, 12] = False
    structures["body_trunc"][2, 2, 2] = False
    after, reports = mended(structures)
    for name, mask in masks().items():
        assert np.array_equal(after[name], mask)
    assert {key: report.voxels for key, report in reports.items()} == {
        ("island", "vertebrae_L1"): 2, ("hole", "vertebrae_L1"): 1, ("hole", "body_trunc"): 1,
    }


def test_overlap_goes_to_the_nearer():
    structures = masks()
    structures["vertebrae_L1"] = block((4, 4, 8), (7, 7, 13))
    structures["vertebrae_L2"] = block((4, 4, 5), (7, 7, 11))
    # Shared planes 8–11; L1 alone 12–13, L2 alone 5–7: 8 and 9 are nearer to L2, 10 and 11 to L1. Then they touch at
    # 9 | 10, and the one with more voxels, L2 with planes 5–9, gives up plane 9.
    after, reports = mended(structures)
    assert np.array_equal(after["vertebrae_L1"], block((4, 4, 10), (7, 7, 13)))
    assert np.array_equal(after["vertebrae_L2"], block((4, 4, 5), (7, 7, 8)))
    assert reports["overlap", "vertebrae_L1 and vertebrae_L2"].voxels == 64
    assert reports["touch", "vertebrae_L1 and vertebrae_L2"].voxels == 16
    assert len(reports) == 2


def test_overlap_with_soft_tissue_goes_to_the_rigid_part():
    structures = masks() | {"muscle": block((2, 4, 11), (5, 7, 13))}
    after, reports = mended(structures, soft=("muscle",))
    assert np.array_equal(after["muscle"], block((2, 4, 11), (3, 7, 13)))
    assert np.array_equal(after["vertebrae_L1"], masks()["vertebrae_L1"])
    assert reports["overlap", "muscle and vertebrae_L1"].voxels == 24


def test_outside_and_exposed_leave_a_voxel_of_soft_tissue():
    structures = masks()
    structures["vertebrae_L1"] = block((4, 4, 11), (7, 10, 13))
    after, reports = mended(structures)
    assert np.array_equal(after["vertebrae_L1"], block((4, 4, 11), (7, 8, 13)))
    assert reports["outside", "vertebrae_L1"].voxels == 12
    assert reports["exposed", "vertebrae_L1"].voxels == 12


def test_names_by_place():
    after, reports = mended(named("vertebrae_L2", "vertebrae_L1", "vertebrae_L3"))
    right = named("vertebrae_L1", "vertebrae_L2", "vertebrae_L3")
    for name, mask in right.items():
        assert np.array_equal(after[name], mask)
    assert [kind for kind, _ in reports] == ["order"]


def test_an_upside_down_image_is_not_renamed():
    _, reports = mended(named("vertebrae_L3", "vertebrae_L2", "vertebrae_L1"))
    assert reports == {}


def test_nothing_left():
    structures = masks()
    structures["vertebrae_L1"] = block((4, 10, 11), (7, 10, 13))
    with pytest.raises(InputError, match=r"vertebrae_L1.*voxels left"):
        repair(segmentation(structures))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_repair_leaves_nothing_repairable_behind(seed):
    rng = np.random.default_rng(seed)
    structures = masks()
    for name in ("vertebrae_L1", "vertebrae_L2"):
        low = rng.integers((3, 3, 5), (5, 5, 9))
        structures[name] = block(low, low + rng.integers(3, 6, 3)) ^ (rng.random(SHAPE) < 0.005)
    structures["body_trunc"] &= rng.random(SHAPE) < 0.995
    try:
        result, _ = repair(segmentation(structures))
    except InputError:
        return
    left = [finding for finding in check(result) if finding.repairable and finding.kind != "order"]
    assert left == []
    label_map = place_in_frame(result)
    assert all((label_map.labels == i + 1).sum() == part.n_voxels
               for i, part in [(label_map.names.index(p.name), p) for p in result.rigid])
