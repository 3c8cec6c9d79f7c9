"""NRRD, MetaImage and other ways to hold the same labels: the same arrays and the same matrix come out of each."""

import bz2
import gzip
import zlib

import nibabel as nib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anatomy.builders import masks, write_folder
from mixpinn.anatomy import read_folder, read_multilabel
from mixpinn.anatomy.images.image_file import label_files, read_label_image
from mixpinn.base.errors import InputError

LABELS = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
AFFINE = np.array([[0, 0, 2.0, 1], [-1.5, 0, 0, 2], [0, 3.0, 0, 3], [0, 0, 0, 1]])
LPS = np.diag([-1.0, -1.0, 1.0, 1.0]) @ AFFINE


def vector(values):
    return "(" + ",".join(f"{value:g}" for value in values) + ")"


def nrrd(path, data=LABELS, matrix=LPS, *, space="left-posterior-superior", encoding="raw", order="little", lines=(),
         none="", leave=""):
    packed = data.astype(data.dtype.newbyteorder("<" if order == "little" else ">")).tobytes(order="F")
    packed = {"raw": bytes, "gzip": gzip.compress, "bzip2": bz2.compress}[encoding](packed)
    header = [
        "NRRD0005", "# made by hand", "type: short", f"dimension: {data.ndim}", f"space: {space}",
        "sizes: " + " ".join(map(str, data.shape)),
        "space directions: " + none + " ".join(vector(matrix[:3, k]) for k in range(3)),
        f"encoding: {encoding}", f"endian: {order}", "space origin: " + vector(matrix[:3, 3]), *lines,
    ]
    header = [line for line in header if not leave or not line.startswith(leave)]
    path.write_bytes("\n".join(header).encode() + b"\n\n" + packed)
    return path


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("order", ["little", "big"])
def test_nrrd(tmp_path, encoding, order):
    image = read_label_image(nrrd(tmp_path / "a.nrrd", encoding=encoding, order=order))
    assert np.array_equal(image.data, LABELS)
    assert np.allclose(image.affine, AFFINE)


@pytest.mark.parametrize(("space", "sign"), [
    ("LPS", [-1, -1, 1, 1]), ("right-anterior-superior", [1, 1, 1, 1]), ("left-anterior-superior", [-1, 1, 1, 1]),
])
def test_nrrd_in_each_frame(tmp_path, space, sign):
    matrix = np.diag(np.array(sign, dtype=float)) @ AFFINE
    assert np.allclose(read_label_image(nrrd(tmp_path / "a.nrrd", matrix=matrix, space=space)).affine, AFFINE)


def test_nrrd_in_centimetres(tmp_path):
    matrix = LPS.copy()
    matrix[:3] /= 10.0
    path = nrrd(tmp_path / "a.nrrd", matrix=matrix, lines=['space units: "cm" "cm" "cm"'])
    assert np.allclose(read_label_image(path).affine, AFFINE)


def test_names_of_a_segmentation(tmp_path):
    lines = ["Segment0_Name:=vertebrae_L1", "Segment0_LabelValue:=7", "Segment1_Name:=body", "Segment1_LabelValue:=2"]
    assert read_label_image(nrrd(tmp_path / "a.seg.nrrd", lines=lines)).names == {7: "vertebrae_L1", 2: "body"}


def test_layers_of_a_segmentation_that_overlaps(tmp_path):
    layers = np.zeros((2, 2, 3, 4), dtype=np.int16)
    layers[0, :, :, :3] = 1  # 18 voxels
    layers[1, 0, 0, :] = 1  # 4 voxels, 3 of them in the first
    lines = ["Segment0_Name:=body", "Segment0_LabelValue:=1", "Segment0_Layer:=0",
             "Segment1_Name:=vertebrae_L1", "Segment1_LabelValue:=1", "Segment1_Layer:=1"]
    image = read_label_image(nrrd(tmp_path / "a.seg.nrrd", layers, lines=lines, none="none "))
    numbers = {name: number for number, name in image.names.items()}
    assert np.array_equal(image.data == numbers["vertebrae_L1"], layers[1] == 1)
    assert np.array_equal(image.data == numbers["body"], (layers[0] == 1) & (layers[1] == 0))
    assert "overlap in 3 voxels" in image.notes[0].detail


@pytest.mark.parametrize(("change", "says"), [
    ({"leave": "space"}, "left and right are unknown"), ({"leave": "type"}, "'type'"), ({"leave": "sizes"}, "'sizes'"),
    ({"space": "scanner-xyz"}, "scanner-xyz"), ({"lines": ["byte skip: -1"]}, "byte skip: -1"),
])
def test_nrrd_that_is_refused(tmp_path, change, says):
    with pytest.raises(InputError, match=says):
        read_label_image(nrrd(tmp_path / "a.nrrd", **change))


def test_nrrd_cut_short(tmp_path):
    path = nrrd(tmp_path / "a.nrrd", encoding="gzip")
    path.write_bytes(path.read_bytes()[:-6])
    with pytest.raises(InputError, match="damaged"):
        read_label_image(path)
    path = nrrd(tmp_path / "b.nrrd")
    path.write_bytes(path.read_bytes()[:-6])
    with pytest.raises(InputError, match="48 bytes of voxels, got 42"):
        read_label_image(path)


def metaimage(path, data=LABELS, matrix=LPS, *, compressed=False, order="little", local=True, leave="", letters=""):
    sizes = np.linalg.norm(matrix[:3, :3], axis=0)
    turn = (matrix[:3, :3] / sizes).T  # a row an axis
    packed = data.astype(data.dtype.newbyteorder("<" if order == "little" else ">")).tobytes(order="F")
    packed = zlib.compress(packed) if compressed else packed
    lines = [
        "ObjectType = Image", "NDims = 3", "BinaryData = True", f"BinaryDataByteOrderMSB = {order == 'big'}",
        f"CompressedData = {compressed}", "TransformMatrix = " + " ".join(f"{v:g}" for v in turn.ravel()),
        "Offset = " + " ".join(f"{v:g}" for v in matrix[:3, 3]),
        "ElementSpacing = " + " ".join(f"{v:g}" for v in sizes), "DimSize = " + " ".join(map(str, data.shape)),
        "ElementType = MET_SHORT",
    ]
    lines = [line for line in lines if not leave or not line.startswith(leave)]
    lines += [f"AnatomicalOrientation = {letters}"] if letters else []
    end = f"ElementDataFile = {'LOCAL' if local else 'voxels.raw'}\n"
    path.write_bytes(("\n".join(lines) + "\n" + end).encode() + (packed if local else b""))
    if not local:
        (path.parent / "voxels.raw").write_bytes(packed)
    return path


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("name", ["a.mha", "a.mhd"])
def test_metaimage(tmp_path, compressed, order, name):
    path = metaimage(tmp_path / name, compressed=compressed, order=order, local=name.endswith("mha"))
    image = read_label_image(path)
    assert np.array_equal(image.data, LABELS)
    assert np.allclose(image.affine, AFFINE)


@pytest.mark.parametrize(("leave", "says"), [
    ("TransformMatrix", "left and right are unknown"), ("ElementSpacing", "spacing"), ("ElementType", "ElementType"),
    ("DimSize", "3 numbers"), ("NDims", "3-D"),
])
def test_metaimage_that_is_refused(tmp_path, leave, says):
    with pytest.raises(InputError, match=says):
        read_label_image(metaimage(tmp_path / "a.mha", leave=leave))


@pytest.mark.parametrize("letters", ["AIL", "PSR", "ail", "???", "RA", "XYZ"])
def test_letters_that_fit_the_matrix_or_say_nothing(tmp_path, letters):
    """The axes of `AFFINE` go to the back, up and to the right."""
    assert read_label_image(metaimage(tmp_path / "a.mha", letters=letters)).notes == ()


@pytest.mark.parametrize("letters", ["AIR", "PIL", "RAI", "LPS", "ASL"])
def test_letters_that_contradict_the_matrix(tmp_path, letters):
    (note,) = read_label_image(metaimage(tmp_path / "a.mha", letters=letters)).notes
    assert (note.kind, note.error) == ("affine", True)
    assert f"TransformMatrix says AIL, AnatomicalOrientation {letters}" in note.detail


def test_oblique_axes_have_the_letters_of_the_nearest_side(tmp_path):
    axis = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)  # as far from every axis of the body as can be
    turned = np.eye(4)
    turned[:3, :3] = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0].as_matrix()
    assert read_label_image(metaimage(tmp_path / "a.mha", matrix=turned, letters="RAI")).notes == ()


def test_every_container_of_a_folder(tmp_path):
    want = read_folder(write_folder(tmp_path / "nii", affine=AFFINE))
    folder = tmp_path / "mixed"
    folder.mkdir()
    body, first, second = (masks()[name].astype(np.int16) for name in ("body_trunc", "vertebrae_L1", "vertebrae_L2"))
    nrrd(folder / "body_trunc.nrrd", body, encoding="gzip")
    metaimage(folder / "vertebrae_L1.MHA", first)
    nib.save(nib.Nifti1Pair(second, AFFINE), folder / "vertebrae_L2.img")
    read = read_folder(folder)
    assert np.allclose(read.affine, want.affine)
    for one, other in zip((read.body, *read.rigid), (want.body, *want.rigid), strict=True):
        assert one.name == other.name
        assert np.array_equal(one.mask, other.mask)


def test_files_that_are_no_masks_are_not_listed(tmp_path):
    write_folder(tmp_path)
    for name in (".DS_Store", "._vertebrae_L1.nii.gz", "Thumbs.db", "readme.txt"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "vertebrae_L2.nii.gz").rename(tmp_path / "vertebrae_L2.NII.GZ")
    assert sorted(label_files(tmp_path)) == ["body_trunc", "vertebrae_L1", "vertebrae_L2"]
    nrrd(tmp_path / "body_trunc.nrrd")
    with pytest.raises(InputError, match=r"body_trunc\.nii\.gz and body_trunc\.nrrd"):
        label_files(tmp_path)


def test_a_folder_of_something_else_says_what_it_holds(tmp_path):
    (tmp_path / "IM1.dcm").write_bytes(b"x")
    with pytest.raises(InputError, match=r"files of \.dcm"):
        read_folder(tmp_path)
    with pytest.raises(InputError, match="DICOM"):
        read_multilabel(tmp_path / "IM1.dcm")
