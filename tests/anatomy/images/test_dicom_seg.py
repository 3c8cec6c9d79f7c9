"""Segmentations in DICOM, written here by pydicom: places, names and overlaps as the file says them."""

import nibabel as nib
import numpy as np
import pytest

from anatomy.builders import SHAPE, masks
from mixpinn.anatomy import read_multilabel
from mixpinn.anatomy.images.image_file import read_label_image
from mixpinn.base.errors import InputError

pydicom = pytest.importorskip("pydicom", reason="the extra 'dicom' is not installed")

CT, SEG, LABEL_MAP = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"
COSINES = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0]])
"""Directions along a row and along a column, LPS."""
ORIGIN, SPACING, BETWEEN = np.array([10.0, -20.0, 30.0]), (1.5, 2.0), 3.0
"""Place of the first voxel (LPS), distance between rows and between columns, and between slices [mm]."""


def sequence(**values):
    item = pydicom.Dataset()
    for name, value in values.items():
        setattr(item, name, value)
    return pydicom.Sequence([item])


def write(path, frames, *, segments, of_frame, slices, kind=SEG, type_="BINARY", syntax="1.2.840.10008.1.2.1", **more):
    """A segmentation of `frames` (f, rows, columns), each of one segment (number from 1) in one slice."""
    seg = pydicom.Dataset()
    seg.file_meta = pydicom.dataset.FileMetaDataset()
    seg.file_meta.TransferSyntaxUID = pydicom.uid.UID(syntax)
    seg.file_meta.MediaStorageSOPClassUID = seg.SOPClassUID = kind
    seg.file_meta.MediaStorageSOPInstanceUID = seg.SOPInstanceUID = pydicom.uid.generate_uid()
    seg.Modality, seg.SegmentationType = "SEG", type_
    seg.NumberOfFrames, seg.Rows, seg.Columns = frames.shape
    seg.SamplesPerPixel, seg.PhotometricInterpretation, seg.PixelRepresentation = 1, "MONOCHROME2", 0
    bits = 1 if type_ == "BINARY" else 8
    seg.BitsAllocated, seg.BitsStored, seg.HighBit = bits, bits, bits - 1
    if type_ == "FRACTIONAL":
        seg.MaximumFractionalValue, seg.SegmentationFractionalType = 255, "PROBABILITY"
    packed = np.packbits(frames.ravel().astype(bool), bitorder="little") if bits == 1 else frames.astype(np.uint8)
    content = packed.tobytes()
    seg.PixelData = content + b"\0" * (len(content) % 2)
    seg.SegmentSequence = pydicom.Sequence([
        sequence(SegmentNumber=number, SegmentLabel=name, SegmentAlgorithmType="MANUAL")[0]
        for number, name in enumerate(segments, start=1)
    ])
    normal = np.cross(*COSINES)
    measures = {"PixelSpacing": list(SPACING), "SliceThickness": BETWEEN} | more.pop("measures", {})
    seg.SharedFunctionalGroupsSequence = sequence(
        PixelMeasuresSequence=sequence(**measures),
        PlaneOrientationSequence=sequence(ImageOrientationPatient=COSINES.ravel().tolist()),
    )
    seg.PerFrameFunctionalGroupsSequence = pydicom.Sequence([
        sequence(
            PlanePositionSequence=sequence(ImagePositionPatient=np.round(ORIGIN + k * BETWEEN * normal, 4).tolist()),
            **({} if type_ == "LABELMAP" else {
                "SegmentIdentificationSequence": sequence(ReferencedSegmentNumber=number)
            }),
        )[0] for number, k in zip(of_frame, slices, strict=True)
    ])
    for name, value in more.items():
        setattr(seg, name, value)
    seg.save_as(path, enforce_file_format=True)
    return path


def place(image, i, j, k):
    return (image.affine @ [i, j, k, 1.0])[:3]


def expected(column, row, number):
    """Place in RAS of a voxel by its row, its column and its slice."""
    lps = ORIGIN + column * SPACING[1] * COSINES[0] + row * SPACING[0] * COSINES[1]
    lps = lps + number * BETWEEN * np.cross(*COSINES)
    return lps * [-1.0, -1.0, 1.0]


def two_segments(path, **more):
    """Segments of two slices each in any order; nothing in slice 2, so the file leaves it out."""
    frames = np.zeros((4, 3, 5), dtype=np.uint8)
    frames[0, 1, 2] = frames[1, 2, 4] = frames[2, 0, 1] = frames[3, 2, 0] = 1
    return write(
        path, frames, segments=["vertebrae_L1", "L2 vertebra"], of_frame=[2, 1, 1, 2], slices=[3, 0, 1, 0], **more,
    )


def test_slices_names_and_frame(tmp_path):
    image = read_label_image(two_segments(tmp_path / "seg.dcm"))
    assert image.data.shape == (5, 3, 4)
    number = {name: value for value, name in image.names.items()}
    found = {tuple(at): image.data[tuple(at)] for at in np.argwhere(image.data)}
    first, second = number["vertebrae_L1"], number["L2 vertebra"]
    assert found == {(2, 1, 3): second, (4, 2, 0): first, (1, 0, 1): first, (0, 2, 0): second}
    for at in found:
        np.testing.assert_allclose(place(image, *at), expected(*at), atol=1e-3)
    assert not image.notes


def test_slices_that_claim_more_than_a_label_map_holds_are_refused(tmp_path):
    """Two slices of 3 × 5 voxels with a hundred million absent ones between them."""
    frames = np.ones((2, 3, 5), dtype=np.uint8)
    path = write(
        tmp_path / "seg.dcm", frames, segments=["vertebrae_L1"], of_frame=[1, 1], slices=[0, 10**8],
        measures={"SpacingBetweenSlices": BETWEEN},
    )
    with pytest.raises(InputError, match=r"at most 1,073,741,824 voxels, got 5 × 3 × 100000001"):
        read_label_image(path)


def test_a_file_without_suffix_is_known_by_its_content(tmp_path):
    named = read_label_image(two_segments(tmp_path / "seg.dcm"))
    image = read_label_image(two_segments(tmp_path / "IM000001"))
    assert np.array_equal(image.data, named.data)


def test_the_same_anatomy_as_by_nifti(tmp_path):
    structures = masks()
    axes = {name: mask.transpose(2, 1, 0) for name, mask in structures.items()}  # slice, row, column
    entries = [(n, k) for n, name in enumerate(axes, start=1) for k in range(SHAPE[2]) if axes[name][k].any()]
    frames = np.stack([axes[list(axes)[n - 1]][k] for n, k in entries])
    path = write(
        tmp_path / "seg.dcm", frames, segments=list(axes), of_frame=[n for n, _ in entries],
        slices=[k for _, k in entries], measures={"SpacingBetweenSlices": BETWEEN},
    )
    segmentation = read_multilabel(path)
    assert {part.name for part in segmentation.rigid} == {"vertebrae_L1", "vertebrae_L2"}
    labels = np.zeros(SHAPE, dtype=np.uint8)
    for number, name in enumerate(structures, start=1):
        labels[structures[name]] = number
    affine = np.eye(4)
    affine[:3, 3] = expected(0, 0, 0)
    affine[:3, :3] = np.stack([expected(*at) - expected(0, 0, 0) for at in np.eye(3)], axis=1)
    nib.save(nib.Nifti1Image(labels, affine), tmp_path / "same.nii.gz")
    same = read_multilabel(tmp_path / "same.nii.gz", names=dict(enumerate(structures, start=1)))
    for part, other in zip((segmentation.body, *segmentation.rigid), (same.body, *same.rigid), strict=True):
        assert part.n_voxels == other.n_voxels
        np.testing.assert_allclose(
            segmentation.affine @ [*part.centroid, 1.0], same.affine @ [*other.centroid, 1.0], atol=1e-3,
        )


def test_fractions_and_label_maps(tmp_path):
    frames = np.array([[[0, 100, 128, 255]]], dtype=np.uint8)
    image = read_label_image(write(
        tmp_path / "fractions.dcm", frames, segments=["a"], of_frame=[1], slices=[0], type_="FRACTIONAL",
    ))
    assert image.data.ravel().tolist() == [0, 0, 1, 1]
    assert "half" in image.notes[0].detail
    frames = np.array([[[0, 1, 2]], [[2, 0, 0]]], dtype=np.uint8)
    image = read_label_image(write(
        tmp_path / "labels.dcm", frames, segments=["a", "b"], of_frame=[0, 0], slices=[1, 0], type_="LABELMAP",
        kind=LABEL_MAP,
    ))
    assert image.names == {1: "a", 2: "b"}
    assert image.data[:, 0].T.tolist() == [[2, 0, 0], [0, 1, 2]]


@pytest.mark.parametrize(("change", "said"), [
    ({"kind": CT}, "CT Image Storage"),
    ({"SegmentSequence": None}, "readable"),
    ({"PerFrameFunctionalGroupsSequence": None}, "readable"),
    ({"NumberOfFrames": 400}, "bytes of voxels"),
    ({"SharedFunctionalGroupsSequence": None}, "PixelMeasuresSequence|PlaneOrientationSequence"),
])
def test_others_are_refused_in_one_line(tmp_path, change, said):
    path = two_segments(tmp_path / "seg.dcm", **{key: value for key, value in change.items() if value is not None})
    if None in change.values():
        image = pydicom.dcmread(path)
        delattr(image, next(iter(change)))
        image.save_as(path)
    with pytest.raises(InputError, match=said) as caught:
        read_label_image(path)
    assert len(str(caught.value).splitlines()) == 1


def test_slices_at_odd_distances_are_refused(tmp_path):
    frames = np.ones((3, 2, 2), dtype=np.uint8)
    path = write(tmp_path / "seg.dcm", frames, segments=["a"], of_frame=[1, 1, 1], slices=[0, 1, 2.4])
    with pytest.raises(InputError, match="even distances"):
        read_label_image(path)


def test_every_cut_file_is_refused_in_one_line(tmp_path):
    content = two_segments(tmp_path / "seg.dcm").read_bytes()
    for end in range(140, len(content), 37):
        (tmp_path / "cut.dcm").write_bytes(content[:end])
        with pytest.raises(InputError):
            read_label_image(tmp_path / "cut.dcm")


def test_without_the_extra_it_says_how_to_get_it(tmp_path, monkeypatch):
    path = two_segments(tmp_path / "seg.dcm")
    monkeypatch.setitem(__import__("sys").modules, "pydicom", None)
    with pytest.raises(InputError, match=r"mixpinn\[dicom\]"):
        read_label_image(path)
