"""Array files: bit-exact round trip, refusal of every kind of damage."""

import errno
import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.tensor_file import read_arrays, write_arrays


def arrays() -> dict[str, AnyArray]:
    """Several types, a scalar, an empty one, and two that share memory."""
    base = np.linspace(-1.0, 1.0, 12, dtype=np.float32).reshape(3, 4)
    return {
        "base": base, "view": base.T, "scalar": np.array(3.5), "empty": np.zeros((0, 3), np.float32),
        "flags": np.array([True, False]), "index": np.array([2**40, -1]),
        "odd": np.array([float("nan"), -0.0], np.float32),
    }


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    write_arrays(path, arrays(), about={"epoch": 3, "loss": 1 / 3})
    read, about = read_arrays(path)
    assert about == {"epoch": 3, "loss": 1 / 3}
    assert read.keys() == arrays().keys()
    for name, array in arrays().items():
        assert read[name].dtype == array.dtype
        assert read[name].shape == array.shape
        # Compared as bytes: nan and the sign of zero count.
        assert read[name].tobytes() == array.tobytes()
        assert read[name].flags.writeable


def test_the_checksum_is_over_torch_names_shapes_and_bytes(tmp_path: Path) -> None:
    # The rule of the first writer of these files, which held torch tensors.
    tensors = {name: torch.from_numpy(array.copy()) for name, array in arrays().items()}
    digest = hashlib.sha256(b"null")
    for name in sorted(tensors):
        tensor = tensors[name].contiguous()
        digest.update(f"{name}{tensor.dtype}{tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    path = tmp_path / "old.safetensors"
    whole = {name: tensor.contiguous().clone() for name, tensor in tensors.items()}
    save_file(whole, path, metadata={"about": "null", "sha256": digest.hexdigest()})
    read, about = read_arrays(path)
    assert about is None
    assert all(read[name].tobytes() == array.tobytes() for name, array in arrays().items())


def test_reading_needs_no_torch(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    write_arrays(path, arrays())
    script = (
        "import sys; from mixpinn.base.tensor_file import read_arrays; read_arrays(sys.argv[1]); "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", script, str(path)], timeout=60).returncode == 0


@pytest.mark.parametrize("kept", [0, 7, 100, -1, -40])
def test_truncated_files_are_refused(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "file.safetensors"
    write_arrays(path, arrays())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match="damaged"):
        read_arrays(path)


def test_a_flipped_bit_is_found_by_the_checksum(tmp_path: Path) -> None:
    path = tmp_path / "file.safetensors"
    write_arrays(path, arrays())
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match="checksum"):
        read_arrays(path)


def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file.safetensors"
    write_arrays(path, arrays(), about="old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="room to write"):
        write_arrays(path, arrays(), about="new")
    assert read_arrays(path)[1] == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_absent_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_arrays(tmp_path / "none.safetensors")
