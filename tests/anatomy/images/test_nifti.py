import gzip

import nibabel as nib
import numpy as np
import pytest

from anatomy.builders import write_nifti
from mixpinn.anatomy.images.image_file import read_label_image
from mixpinn.base.errors import InputError

LABELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
AFFINE = np.array([[0, 0, 2.0, 1], [-1.5, 0, 0, 2], [0, 3.0, 0, 3], [0, 0, 0, 1]])


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
@pytest.mark.parametrize("kind", [nib.Nifti1Image, nib.Nifti2Image])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, ">i2", np.float32, np.float64])
def test_reads_labels_and_affine(tmp_path, name, kind, dtype):
    nib.save(kind(LABELS.astype(dtype), AFFINE), tmp_path / name)
    image = read_label_image(tmp_path / name)
    assert np.array_equal(image.data, LABELS)
    assert image.data.dtype == np.uint8
    assert np.allclose(image.affine, AFFINE)


def test_trailing_axis_of_one_is_no_fourth_dimension(tmp_path):
    assert read_label_image(write_nifti(tmp_path / "a.nii", LABELS[..., None])).data.shape == (2, 3, 4)


def test_metres_become_millimetres(tmp_path):
    image = nib.Nifti1Image(LABELS, np.diag([0.001, 0.001, 0.002, 1.0]))
    image.header.set_xyzt_units("meter")
    nib.save(image, tmp_path / "a.nii")
    assert np.allclose(read_label_image(tmp_path / "a.nii").affine, np.diag([1.0, 1.0, 2.0, 1.0]))


def refuses(path, expected):
    with pytest.raises(InputError) as caught:
        read_label_image(path)
    message = str(caught.value)
    assert expected in message
    assert path.name in message
    assert "\n" not in message


def test_absent(tmp_path):
    refuses(tmp_path / "absent.nii.gz", "no such file")


def test_truncated_gzip(tmp_path):
    path = write_nifti(tmp_path / "a.nii.gz", np.random.default_rng(0).integers(0, 9, (20, 20, 20)).astype(np.uint8))
    path.write_bytes(path.read_bytes()[:-400])
    refuses(path, "damaged")


def test_flipped_bit_is_found_by_the_checksum(tmp_path):
    path = write_nifti(tmp_path / "a.nii.gz", np.random.default_rng(0).integers(0, 9, (20, 20, 20)).astype(np.uint8))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))
    refuses(path, "damaged")


def test_truncated_before_compression(tmp_path):
    path = write_nifti(tmp_path / "a.nii", LABELS)
    content = path.read_bytes()[:-5]
    path.write_bytes(content)
    refuses(path, "damaged")
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress(content))
    refuses(tmp_path / "b.nii.gz", "damaged")


def test_an_empty_file_is_called_so(tmp_path):
    (tmp_path / "a.nii.gz").touch()
    refuses(tmp_path / "a.nii.gz", "an empty file")


@pytest.mark.parametrize("content", [b"no image at all", bytes(2000), gzip.compress(b"text", mtime=0)])
def test_not_a_nifti(tmp_path, content):
    (tmp_path / "a.nii.gz").write_bytes(content)
    refuses(tmp_path / "a.nii.gz", "another kind of file")


def test_four_dimensions(tmp_path):
    refuses(write_nifti(tmp_path / "a.nii", np.zeros((2, 3, 4, 2), dtype=np.uint8)), "4-D")


def test_singular_affine(tmp_path):
    affine = np.eye(4)
    affine[:3, 2] = affine[:3, 1]
    image = nib.Nifti1Image(LABELS, None)
    image.header.set_sform(affine, code=1)
    nib.save(image, tmp_path / "a.nii")
    refuses(tmp_path / "a.nii", "singular")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_affine_not_finite(tmp_path, value):
    path = write_nifti(tmp_path / "a.nii", LABELS)
    content = bytearray(path.read_bytes())
    content[280:284] = np.float32(value).tobytes()  # first entry of the header's sform
    path.write_bytes(bytes(content))
    refuses(path, "finite affine")


def test_no_affine_at_all(tmp_path):
    nib.save(nib.Nifti1Image(LABELS, None), tmp_path / "a.nii")
    refuses(tmp_path / "a.nii", "sform or qform")


@pytest.mark.parametrize(("data", "expected"), [
    (np.array([0.0, 0.5], dtype=np.float32), "continuous"),
    (np.array([0.0, np.nan], dtype=np.float32), "NaN"),
    (np.array([-1024, 300], dtype=np.int16), "-1024"),
    (np.array([0, 100000], dtype=np.int32), "100000"),
    (np.array([0, 1j], dtype=np.complex64), "complex64"),
])
def test_not_a_label_map(tmp_path, data, expected):
    refuses(write_nifti(tmp_path / "a.nii", data.reshape(2, 1, 1)), expected)


@pytest.mark.parametrize("kind", [nib.Nifti1Image, nib.Nifti2Image])
def test_big_endian(tmp_path, kind):
    header = (nib.Nifti1Header if kind is nib.Nifti1Image else nib.Nifti2Header)(endianness=">")
    nib.save(kind(LABELS.astype(np.uint16), AFFINE, header), tmp_path / "a.nii.gz")
    assert np.array_equal(read_label_image(tmp_path / "a.nii.gz").data, LABELS)


@pytest.mark.parametrize("kind", [nib.Nifti1Pair, nib.Nifti2Pair])
@pytest.mark.parametrize("half", ["a.hdr", "a.img"])
def test_pairs(tmp_path, kind, half):
    nib.save(kind(LABELS, AFFINE), tmp_path / "a.img")
    image = read_label_image(tmp_path / half)
    assert np.array_equal(image.data, LABELS)
    assert np.allclose(image.affine, AFFINE)


def test_half_a_pair_and_analyze_without_orientation(tmp_path):
    nib.save(nib.Nifti1Pair(LABELS, AFFINE), tmp_path / "a.img")
    (tmp_path / "a.hdr").unlink()
    refuses(tmp_path / "a.img", "other half")
    nib.save(nib.AnalyzeImage(LABELS, AFFINE), tmp_path / "b.img")
    refuses(tmp_path / "b.img", "left from right")


def test_labels_under_a_scaled_header_are_rounded_with_a_note(tmp_path):
    labels = LABELS.astype(float) * 3.0
    header = nib.Nifti1Header()
    header.set_data_dtype(np.int16)
    header.set_slope_inter(3.0 * 23 / 65535, 34.5)  # what is chosen for floating-point data under an integer header
    image = nib.Nifti1Image(np.rint((labels - 34.5) / (3.0 * 23 / 65535)).astype(np.int16), AFFINE, header)
    image.header.set_slope_inter(3.0 * 23 / 65535, 34.5)
    nib.save(nib.Nifti1Image(labels, AFFINE, header), tmp_path / "a.nii")
    stored = np.asarray(nib.load(tmp_path / "a.nii").dataobj)
    assert (stored != np.rint(stored)).any()
    image = read_label_image(tmp_path / "a.nii")
    assert np.array_equal(image.data, labels)
    note, = image.notes
    assert note.kind == "values"
    assert "rounded" in note.detail


def test_continuous_values_are_named_with_their_deviation(tmp_path):
    refuses(write_nifti(tmp_path / "a.nii", np.array([0.0, 0.3]).reshape(2, 1, 1)), "0.3 off")


def test_noise_on_labels_is_rounded_and_on_probabilities_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 30, (16, 16, 16))
    noisy = labels + rng.normal(0.0, 1e-3, labels.shape)
    assert len(np.unique(noisy)) > 1024
    found = read_label_image(write_nifti(tmp_path / "a.nii", noisy))
    assert np.array_equal(found.data, labels)
    assert "rounded" in found.notes[0].detail
    soft = np.linspace(0.0, 1.0, 64).reshape(4, 4, 4)
    refuses(write_nifti(tmp_path / "b.nii", soft), "1 where it is above a half")


def test_colours_are_no_labels(tmp_path):
    colours = np.zeros((2, 2, 2), dtype=[("R", "u1"), ("G", "u1"), ("B", "u1")])
    nib.save(nib.Nifti1Image(colours, np.eye(4)), tmp_path / "a.nii")
    refuses(tmp_path / "a.nii", "got colours; export the numbers of the labels instead")


def test_nibabel_says_nothing_beside_the_one_line(tmp_path, capfd):
    """A header that it would talk about: a form of the matrix that does not exist."""
    path = write_nifti(tmp_path / "a.nii", np.ones((2, 2, 2), dtype=np.uint8))
    content = bytearray(path.read_bytes())
    content[254:256] = (9).to_bytes(2, "little")  # sform_code
    path.write_bytes(content)
    with pytest.raises(InputError, match="a header with neither"):
        read_label_image(path)
    assert capfd.readouterr() == ("", "")
    assert not nib.imageglobals.logger.disabled


def names_extension(names):
    rows = "".join(f'<Label Key="{key}" Red="1"><![CDATA[{name}]]></Label>' for key, name in names.items())
    text = f"<?xml version='1.0'?><CaretExtension><LabelTable>{rows}</LabelTable></CaretExtension>"
    return nib.nifti1.Nifti1Extension(0, text.encode())


def test_names_in_the_header(tmp_path):
    image = nib.Nifti1Image(LABELS, AFFINE)
    image.header.extensions.append(nib.nifti1.Nifti1Extension("comment", b"<Label of nothing"))
    image.header.extensions.append(names_extension({0: "background", 3: "vertebrae_L1", 4: "body"}))
    nib.save(image, tmp_path / "a.nii.gz")
    assert read_label_image(tmp_path / "a.nii.gz").names == {3: "vertebrae_L1", 4: "body"}


def two_matrices(path, sform, qform):
    header = nib.Nifti1Header()
    header.set_data_shape(LABELS.shape)
    header.set_qform(qform, 1)
    header.set_sform(sform, 1)
    nib.save(nib.Nifti1Image(LABELS, None, header), path)
    return read_label_image(path)


def turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    return turn


@pytest.mark.parametrize(("change", "says"), [
    (np.diag([0.25, 0.25, 0.25, 1.0]), "1 × 0.5 × 0.75 mm, the qform of 4 × 2 × 3 mm"),
    (np.diag([-1.0, 1.0, 1.0, 1.0]), "handedness"),
    (np.diag([-1.0, -1.0, 1.0, 1.0]), "turned against each other by 180°"),
])
def test_matrices_that_contradict_each_other_about_scale_or_sides_are_errors(tmp_path, change, says):
    matrix = np.diag([4.0, 2.0, 3.0, 1.0])
    note, = two_matrices(tmp_path / "a.nii", change @ matrix, matrix).notes
    assert (note.kind, note.error) == ("affine", True)
    assert says in note.detail


def test_matrices_that_contradict_each_other_about_the_place_are_named(tmp_path):
    matrix = np.diag([4.0, 2.0, 3.0, 1.0])
    moved = matrix.copy()
    moved[:3, 3] = [30.0, 0.0, 0.0]
    note, = two_matrices(tmp_path / "a.nii", moved, matrix).notes
    assert (note.kind, note.error) == ("affine", False)
    assert "30.0, 0.0, 0.0 and 0.0, 0.0, 0.0 mm" in note.detail
    note, = two_matrices(tmp_path / "a.nii", turned(10.0) @ matrix, matrix).notes
    assert "turned by 10.0°" in note.detail
    assert not note.error
    assert two_matrices(tmp_path / "a.nii", matrix, matrix).notes == ()


def test_an_sform_that_turns_two_axes_the_same_way_is_refused(tmp_path):
    flat = np.diag([4.0, 2.0, 3.0, 1.0])
    flat[:3, 1] = flat[:3, 0]
    with pytest.raises(InputError, match="singular"):
        two_matrices(tmp_path / "a.nii", flat, np.diag([4.0, 4.0, 3.0, 1.0]))


def test_pixdim_that_contradicts_the_only_matrix_is_named(tmp_path):
    header = nib.Nifti1Header()
    header.set_data_shape(LABELS.shape)
    header.set_sform(np.diag([4.0, 4.0, 4.0, 1.0]), 1)
    nib.save(nib.Nifti1Image(LABELS, None, header), tmp_path / "a.nii")
    with (tmp_path / "a.nii").open("r+b") as file:
        file.seek(80)
        file.write(np.array([1.0, 1.0, 1.0], dtype="<f4").tobytes())
    note, = read_label_image(tmp_path / "a.nii").notes
    assert "4 × 4 × 4 mm, pixdim says 1 × 1 × 1 mm" in note.detail
