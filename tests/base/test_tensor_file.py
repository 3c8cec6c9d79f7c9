"""Tensor files: bit-exact round trip, refusal of every kind of damage."""

import errno
from pathlib import Path

import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_tensors, write_tensors


def tensors() -> dict[str, torch.Tensor]:
    """Several types, a scalar, an empty one, and two that share memory."""
    base = torch.linspace(-1.0, 1.0, 12).view(3, 4)
    return {
        "base": base, "view": base.T, "scalar": torch.tensor(3.5, dtype=torch.float64), "empty": torch.zeros(0, 3),
        "flags": torch.tensor([True, False]), "index": torch.tensor([2**40, -1]),
        "odd": torch.tensor([float("nan"), -0.0]),
    }


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    write_tensors(path, tensors(), about={"epoch": 3, "loss": 1 / 3})
    read, about = read_tensors(path)
    assert about == {"epoch": 3, "loss": 1 / 3}
    assert read.keys() == tensors().keys()
    for name, tensor in tensors().items():
        assert read[name].dtype == tensor.dtype
        # Compared as bytes: nan and the sign of zero count.
        assert read[name].numpy().tobytes() == tensor.contiguous().numpy().tobytes()


@pytest.mark.parametrize("kept", [0, 7, 100, -1, -40])
def test_truncated_files_are_refused(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "file.safetensors"
    write_tensors(path, tensors())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match="damaged"):
        read_tensors(path)


def test_a_flipped_bit_is_found_by_the_checksum(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    write_tensors(path, tensors())
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match="checksum"):
        read_tensors(path)


def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file.safetensors"
    write_tensors(path, tensors(), about="old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="room to write"):
        write_tensors(path, tensors(), about="new")
    assert read_tensors(path)[1] == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_absent_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_tensors(tmp_path / "none.safetensors")
