"""What is unlike a body: lengths, direction, sizes, steps, sides, numbers that mean something else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anatomy.builders import block, masks, segmentation, write_folder, write_nifti
from mixpinn.anatomy import TOTAL_CLASSES, PhantomConfig, Structure, phantom_segmentation, read_folder, read_multilabel
from mixpinn.anatomy.checks.back import check_back
from mixpinn.anatomy.checks.numbering import check_numbering, look
from mixpinn.anatomy.checks.plausible import check_plausible
from mixpinn.anatomy.checks.sides import check_sides
from mixpinn.anatomy.names import TOTAL_CLASSES_V1

SCALE = np.diag([10.0, 10.0, 10.0, 1.0])
SPINE = phantom_segmentation(PhantomConfig(voxel_size=4.0, vertebrae=5))


def scaled(factor):
    return replace(SPINE, affine=np.diag([factor] * 3 + [1.0]) @ SPINE.affine)


def found(read):
    return {(finding.kind, finding.structure): finding for finding in check_plausible(read)}


def test_a_sound_spine_is_plausible():
    assert check_plausible(SPINE) == ()
    assert check_plausible(segmentation(affine=SCALE)) == ()


@pytest.mark.parametrize(("factor", "unit"), [
    (1e-3, "metres"), (0.1, "centimetres"), (10.0, "tenths"), (1e3, "microm"),
])
def test_lengths(factor, unit):
    finding = next(f for f in check_plausible(scaled(factor)) if f.kind == "scale")
    assert finding.error
    assert f"look like {unit}" in finding.detail


def test_one_small_vertebra_is_no_other_unit():
    """A tip of it is all that the image holds: a matter of size."""
    first = SPINE.rigid[0]
    tip = Structure.trim(first.name, first.mask & (np.arange(first.mask.size).reshape(first.mask.shape)
                                                   == np.flatnonzero(first.mask)[0]), first.corner)
    kinds = {kind for kind, _ in found(replace(SPINE, rigid=(tip, *SPINE.rigid[1:])))}
    assert "size" in kinds
    assert "scale" not in kinds


def test_the_same_mask_under_two_names_is_told():
    one, other, *rest = SPINE.rigid
    twice = replace(SPINE, rigid=(one, replace(one, name=other.name), *rest))
    assert any(kind == "missing" for kind, _ in found(twice))


def test_a_spine_in_front_of_the_middle():
    turned = replace(SPINE, affine=np.diag([-1.0, -1.0, 1.0, 1.0]) @ SPINE.affine)
    finding = found(turned)["direction", SPINE.body.name]
    assert finding.error
    assert "LPS matrix written as RAS" in finding.detail


@pytest.mark.parametrize(("rows", "says"), [((0, 2, 1), "front to back"), ((2, 1, 0), "left to right")])
def test_axes_that_are_exchanged(rows, says):
    turned = np.eye(4)
    turned[:3, :3] = np.eye(3)[list(rows)]
    finding = found(replace(SPINE, affine=turned @ SPINE.affine))["direction", SPINE.body.name]
    assert finding.error
    assert f"follow each other from {says}" in finding.detail
    tilted = np.eye(4)
    tilted[1:3, 1:3] = [[0.8, -0.6], [0.6, 0.8]]  # by 37°, as patients lie in scanners
    lying = replace(SPINE, affine=tilted @ SPINE.affine)
    assert not any("follow each other" in finding.detail for finding in check_plausible(lying))


def test_a_vertebra_unlike_its_neighbours():
    part = SPINE.rigid[2]
    half = replace(part, mask=part.mask & (np.arange(part.mask.shape[1]) < part.mask.shape[1] // 3)[:, None])
    finding = found(SPINE.with_part(half))["size", part.name]
    assert "of its neighbours' volume: cut" in finding.detail
    assert not finding.error
    one, other = SPINE.rigid[1], SPINE.rigid[2]
    start = tuple(np.minimum(one.corner, other.corner).tolist())
    stop = tuple(np.maximum(one.stop, other.stop).tolist())
    both = Structure.trim(one.name, one.window(start, stop) | other.window(start, stop), start)
    assert "may hold a part of another" in found(SPINE.with_part(both))["size", one.name].detail


def test_a_missing_and_a_transitional_vertebra():
    names = ["vertebrae_L1", "vertebrae_L2", "vertebrae_L3", "vertebrae_L4"]
    kept = [part for index, part in enumerate(SPINE.rigid) if index != 2]
    gap = replace(SPINE, rigid=tuple(replace(part, name=name) for part, name in zip(kept, names, strict=True)))
    assert "one may be missing" in found(gap)["missing", "vertebrae_L2 and vertebrae_L3"].detail
    last = replace(SPINE.rigid[-1], name="vertebrae_L6")
    assert "transitional" in found(replace(SPINE, rigid=(*SPINE.rigid[:-1], last)))["missing", "vertebrae_L6"].detail


def test_a_table_behind_the_back():
    body = np.pad(block((1, 1, 0), (10, 9, 19)), ((20, 20), (20, 0), (0, 0)))
    spine = np.pad(masks()["vertebrae_L1"], ((20, 20), (20, 0), (0, 0)))
    table = np.zeros_like(body)
    table[8:44, 10:13] = True
    joined = body.copy()
    joined[25:27, 13:21] = True
    read = segmentation({"body_trunc": body, "vertebrae_L1": spine}, affine=SCALE)
    assert list(check_back(read)) == []
    for mask in (body | table, joined | table):
        finding, = check_back(segmentation({"body_trunc": mask, "vertebrae_L1": spine}, affine=SCALE))
        assert finding.kind == "table"


def test_a_back_on_the_circle_of_the_reconstruction():
    i, j = np.meshgrid(np.arange(64), np.arange(64), indexing="ij")
    circle = np.hypot(i - 31.5, j - 31.5) <= 31.5
    body = np.repeat(circle[..., None], 20, axis=2)
    spine = np.zeros_like(body)
    spine[26:34, 10:18, 6:12] = True
    read = segmentation({"body_trunc": body, "vertebrae_L1": spine}, affine=np.diag([8.0, 8.0, 8.0, 1.0]))
    assert any("circle" in finding.detail or "cut off by the field" in finding.detail for finding in check_back(read))


def test_sides():
    left, right = np.array([-50.0, 0, 0]), np.array([50.0, 0, 0])
    assert check_sides({"kidney_left": left, "kidney_right": right, "spleen": left, "liver": right}) == ()
    finding, = check_sides({"spleen": right, "liver": left})
    assert finding.error
    assert "mirrored" in finding.detail


def test_a_mirrored_folder_is_noticed_by_a_pair_that_is_not_asked_for(tmp_path):
    structures = masks() | {"kidney_left": block((2, 4, 8), (2, 5, 9)), "kidney_right": block((9, 4, 8), (9, 5, 9))}
    assert read_folder(write_folder(tmp_path / "right", structures)).notes == ()
    finding, = read_folder(write_folder(tmp_path / "wrong", structures, np.diag([-1.0, 1.0, 1.0, 1.0]))).notes
    assert (finding.kind, finding.error) == ("direction", True)


def column(table, top=1):
    """A column of equal vertebrae, the lowest L5, with the numbers of a table; L5 … T1 for top = 1."""
    names = [f"vertebrae_L{k}" for k in range(5, 0, -1)] + [f"vertebrae_T{k}" for k in range(12, top - 1, -1)]
    numbers = {name: number for number, name in table.items()}
    labels = np.zeros((20, 20, 4 * len(names)), dtype=np.uint8)
    for level, name in enumerate(names):
        labels[8:12, 8:12, 4 * level:4 * level + 3] = numbers[name]
    return labels


def doubts(labels, table=TOTAL_CLASSES):
    seen = look(labels, np.diag([10.0, 10.0, 10.0, 1.0]))
    return check_numbering(seen, {table[n]: n for n in seen}, file=Path("total.nii.gz"))


def test_numbers_of_another_version_are_refused_with_the_remedy():
    assert doubts(column(TOTAL_CLASSES)) == ()
    finding, = doubts(column(TOTAL_CLASSES_V1))
    assert finding.error
    assert "--names total-v1" in finding.detail
    assert doubts(column(TOTAL_CLASSES_V1), TOTAL_CLASSES_V1) == ()


def test_numbers_against_levels_and_sizes():
    labels = column(TOTAL_CLASSES, top=10)
    number = {name: n for n, name in TOTAL_CLASSES.items()}
    for name, place, says in (
        ("liver", (slice(2, 5), slice(2, 5), slice(20, 23)), "'liver' has 27 voxels"),
        ("lung_upper_lobe_left", (slice(2, 5), slice(2, 5), slice(0, 1)), "lies below vertebrae_L5"),
        ("hip_left", (slice(2, 5), slice(2, 5), slice(25, 28)), "lies above vertebrae_L1"),
    ):
        other = labels.copy()
        other[place] = number[name]
        finding, = doubts(other)
        assert says in finding.detail


def test_names_in_the_header_win_over_the_usual_numbers(tmp_path):
    import nibabel as nib

    from anatomy.images.test_nifti import names_extension

    labels = column(TOTAL_CLASSES_V1)
    image = nib.Nifti1Image(labels, SCALE)
    image.header.extensions.append(names_extension(TOTAL_CLASSES_V1))
    nib.save(image, tmp_path / "named.nii.gz")
    body = write_nifti(tmp_path / "body.nii.gz", np.ones(labels.shape, dtype=np.uint8), SCALE)
    read = read_multilabel(tmp_path / "named.nii.gz", body=body)
    lowest = next(part for part in read.rigid if part.name == "vertebrae_L5")
    assert lowest.corner[2] == 0
    assert read.notes == ()
    plain = write_nifti(tmp_path / "plain.nii.gz", labels, SCALE)
    assert [finding.kind for finding in read_multilabel(plain, body=body).notes] == ["numbering"]
    named = read_multilabel(plain, body=body, names="total-v1")
    assert next(part for part in named.rigid if part.name == "vertebrae_L5").corner[2] == 0


def test_another_patient_has_nothing_odd(shared_data):
    folder = shared_data / "patient2"
    read = read_multilabel(folder / "multilabel.nii.gz", body=folder / "segmentations" / "body_trunc.nii.gz")
    assert not any(finding.error for finding in read.notes)
