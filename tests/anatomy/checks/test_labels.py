import numpy as np
import pytest

from anatomy.builders import block, masks, segmentation
from mixpinn.anatomy import Finding, check, require_sound
from mixpinn.base.errors import InputError


def found(structures, **kwargs):
    return {(f.kind, f.structure): f for f in check(segmentation(structures, **kwargs))}


def test_nothing_wrong():
    assert check(segmentation()) == ()


def test_island():
    structures = masks()
    structures["vertebrae_L1"] |= block((4, 4, 16), (4, 4, 17)) | block((8, 8, 14), (8, 8, 14))
    findings = found(structures)
    assert set(findings) == {("island", "vertebrae_L1")}
    assert findings["island", "vertebrae_L1"].voxels == 3  # a voxel that hangs on by a corner is a piece of its own
    assert "2 pieces" in findings["island", "vertebrae_L1"].detail


def test_hole_in_part_and_body():
    structures = masks()
    structures["vertebrae_L1"][5, 5, 12] = False
    structures["body_trunc"][2:4, 2, 2] = False
    findings = found(structures)
    assert {key: f.voxels for key, f in findings.items()} == {
        ("hole", "vertebrae_L1"): 1, ("hole", "body_trunc"): 2,
    }


def test_a_hollow_body_is_an_error_until_it_is_filled():
    structures = masks()
    structures["body_trunc"] &= ~block((2, 2, 1), (9, 8, 18))
    for name in ("vertebrae_L1", "vertebrae_L2"):
        structures["body_trunc"] |= structures[name]
    hole = found(structures)["hole", "body_trunc"]
    assert hole.error
    assert hole.repairable


def test_body_that_leaves_the_bones_out_is_as_good():
    structures = masks()
    structures["body_trunc"] &= ~structures["vertebrae_L1"]
    assert found(structures) == {}


def test_touch_by_corner_and_by_face():
    structures = masks()
    structures["vertebrae_L2"] = block((8, 8, 8), (8, 8, 10))
    assert found(structures)["touch", "vertebrae_L1 and vertebrae_L2"].voxels == 1
    assert "0 face to face" in found(structures)["touch", "vertebrae_L1 and vertebrae_L2"].detail
    structures["vertebrae_L2"] = block((4, 4, 8), (7, 7, 10))
    finding = found(structures)["touch", "vertebrae_L1 and vertebrae_L2"]
    assert finding.voxels == 16
    assert "16 face to face" in finding.detail
    assert not finding.error
    structures["vertebrae_L2"] = block((4, 4, 7), (7, 7, 9))
    assert found(structures) == {}


def test_overlap_is_an_error():
    structures = masks()
    structures["vertebrae_L2"] = block((4, 4, 8), (7, 7, 11))
    finding = found(structures)["overlap", "vertebrae_L1 and vertebrae_L2"]
    assert finding.voxels == 16
    assert finding.error
    assert finding.repairable
    structures["vertebrae_L2"] = block((4, 4, 11), (7, 7, 12))
    assert not found(structures)["overlap", "vertebrae_L1 and vertebrae_L2"].repairable


def test_outside_partly_and_wholly():
    structures = masks()
    structures["vertebrae_L1"] = block((4, 4, 11), (7, 10, 13))
    finding = found(structures)["outside", "vertebrae_L1"]
    assert finding.voxels == 12
    assert finding.error
    assert finding.repairable
    structures["body_trunc"] = block((1, 1, 0), (10, 9, 9))
    finding = found(structures)["outside", "vertebrae_L1"]
    assert finding.error
    assert not finding.repairable


def test_a_part_in_an_island_of_the_body_is_outside():
    structures = masks()
    structures["body_trunc"] = block((1, 1, 0), (10, 9, 9)) | structures["vertebrae_L1"]
    assert ("outside", "vertebrae_L1") in found(structures)


def test_exposed_at_the_skin():
    structures = masks()
    structures["vertebrae_L1"] = block((4, 4, 11), (7, 9, 13))
    finding = found(structures)["exposed", "vertebrae_L1"]
    assert finding.voxels == 12
    assert not finding.error


def test_soft_tissue_outside_is_a_warning_only():
    structures = masks() | {"muscle": block((2, 8, 14), (2, 10, 14))}
    finding = found(structures, soft=("muscle",))["outside", "muscle"]
    assert finding.voxels == 1
    assert not finding.error


def test_cut_off_at_the_image_border():
    structures = masks()
    structures["body_trunc"] = block((0, 1, 0), (10, 9, 19))
    structures["vertebrae_L2"] = block((4, 4, 0), (7, 7, 8))
    findings = found(structures)
    assert findings["cut off", "body_trunc"].voxels == 9 * 20
    assert findings["cut off", "vertebrae_L2"].voxels == 16
    assert not findings["cut off", "vertebrae_L2"].repairable


def named(*names):
    """Vertebrae two planes high and two apart, from the head down."""
    structures = {"body_trunc": masks()["body_trunc"]}
    for i, name in enumerate(names):
        structures[name] = block((4, 4, 17 - 4 * i), (7, 7, 18 - 4 * i))
    return structures


def test_order_along_the_spine():
    assert found(named("vertebrae_L1", "vertebrae_L2", "vertebrae_L3")) == {}
    finding, = check(segmentation(named("vertebrae_L2", "vertebrae_L1", "vertebrae_L3")))
    assert finding.kind == "order"
    assert "vertebrae_L2, vertebrae_L1, vertebrae_L3" in finding.detail
    assert finding.repairable
    assert finding.voxels == 2 * 32


def test_order_follows_the_affine():
    flipped = np.diag([1.0, 1.0, -1.0, 1.0])
    finding, = check(segmentation(named("vertebrae_L1", "vertebrae_L2", "vertebrae_L3"), affine=flipped))
    assert finding.kind == "direction"
    assert "upside down" in finding.detail
    assert finding.error
    assert not finding.repairable


def test_order_of_the_whole_spine_and_gaps_in_it():
    assert found(named("vertebrae_T12", "vertebrae_L1", "vertebrae_L2")) == {}
    assert found(named("vertebrae_L4", "vertebrae_L5", "sacrum")) == {}
    assert ("order", "vertebrae_L1 and sacrum") in found(named("vertebrae_T12", "vertebrae_L1", "sacrum"))
    assert found(named("vertebrae_T12", "vertebrae_L1", "liver")) == {}
    finding, = check(segmentation(named("vertebrae_L1", "vertebrae_L3")))
    assert finding.kind == "order"
    assert finding.structure == "vertebrae_L1 and vertebrae_L3"


def test_findings_say_what_they_are():
    assert str(Finding("hole", "body", "3 voxels", 3)) == "warning: body: hole: 3 voxels"
    assert str(Finding("hole", "body", "3 voxels", 3, error=True)).startswith("error")
    assert str(Finding("hole", "body", "3 voxels", 3, error=True, repaired=True)).startswith("repaired")


def test_require_sound():
    require_sound([
        Finding("hole", "body", "3 voxels", 3), Finding("overlap", "a and b", "x", 3, error=True, repaired=True),
    ])
    with pytest.raises(InputError, match=r"a and b.*16 shared voxels.*repair"):
        require_sound([Finding("overlap", "a and b", "16 shared voxels", 16, error=True)])
    with pytest.raises(InputError, match="segment it again"):
        require_sound([Finding("outside", "a", "all of it outside", 16, error=True, repairable=False)])


