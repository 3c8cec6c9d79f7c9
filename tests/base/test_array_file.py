import io
import zipfile

import numpy as np
import pytest

from mixpinn.base.array_file import read_npy, read_npz

ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.arange(6).reshape(3, 2)), "c": np.array(True)}


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("name", ARRAYS)
def test_as_numpy_reads_them(tmp_path, name, mapped):
    np.save(tmp_path / "x.npy", ARRAYS[name])
    read = read_npy(tmp_path / "x.npy", mapped=mapped)
    np.testing.assert_array_equal(read, ARRAYS[name])
    assert read.dtype == ARRAYS[name].dtype
    assert read.flags.writeable is not mapped


def test_an_archive(tmp_path):
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "x.npz", **ARRAYS)
        for name, array in read_npz(tmp_path / "x.npz").items():
            np.testing.assert_array_equal(array, ARRAYS[name])
        assert list(read_npz(tmp_path / "x.npz", ("a",))) == ["a"]
        with pytest.raises(KeyError, match="d is not among"):
            read_npz(tmp_path / "x.npz", ("d",))


def npy(header):
    text = header.encode() + b" " * (118 - len(header) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(48)


DAMAGED = {
    "more than there is": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,)}"),
    "a negative extent": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-6,)}"),
    "objects": npy("{'descr': '|O', 'fortran_order': False, 'shape': (6,)}"),
    "no type": npy("{'descr': '<f9', 'fortran_order': False, 'shape': (6,)}"),
    "no size": npy("{'descr': '|S0', 'fortran_order': False, 'shape': (6,)}"),
    "no dictionary": npy("(((((((((((("), "code": npy("__import__('os').system('true')"),
    "short": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (6,)}")[:-1],
    "long": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (6,)}") + b"\x00", "nothing": b"",
    "a pickle": b"\x80\x04N.", "text": b"node,dx,dy,dz\n",
}


def test_the_maker_of_headers_makes_sound_ones(tmp_path):
    (tmp_path / "x.npy").write_bytes(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (6,)}"))
    assert read_npy(tmp_path / "x.npy").tolist() == np.load(tmp_path / "x.npy").tolist() == [0.0] * 6


@pytest.mark.parametrize("kind", DAMAGED)
def test_damaged_arrays_are_refused(tmp_path, kind):
    (tmp_path / "x.npy").write_bytes(DAMAGED[kind])
    for mapped in (False, True):
        with pytest.raises(ValueError):
            read_npy(tmp_path / "x.npy", mapped=mapped)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("a.npy", DAMAGED[kind])
    with pytest.raises(ValueError):
        read_npz(tmp_path / "x.npz")


def test_damaged_archives_are_refused(tmp_path):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, a=np.zeros(100_000))
    content = buffer.getvalue()
    assert content.count(b"PK\x01\x02") == 1
    directory = content.index(b"PK\x01\x02")
    claims = content[: directory + 24] + (1 << 20).to_bytes(4, "little") + content[directory + 28:]
    for damaged in (content[:-9], b"", content[:150] + b"\xff" * 9 + content[159:], claims):
        (tmp_path / "x.npz").write_bytes(damaged)
        with pytest.raises((ValueError, OSError)):
            read_npz(tmp_path / "x.npz")
