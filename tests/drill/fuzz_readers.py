"""Coverage-guided fuzzing of the readers of foreign and own files: whatever the bytes, an answer or one line.

    python tests/drill/fuzz_readers.py READER CORPUS [options of libFuzzer, such as -max_total_time=600]

READER is one of `READERS`; CORPUS is a folder for inputs that reach new code, begun with small sound files. It needs
the extra ``fuzz`` (atheris) and is never part of the tests; what it found is kept in ``test_fuzz_found.py``, which is.
"""

import contextlib
import gzip
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "src")]

from drill.fuzz_bundles import BundleReader, sound_bundle  # noqa: E402 (found from here on)
from drill.fuzz_foreign import foreign_seeds, read_foreign  # noqa: E402


def _tables(folder: Path, content: bytes) -> None:
    """The first byte says which table it is."""
    from mixpinn.anatomy.name_table import read_names
    from mixpinn.base.config import build_config, read_config_file
    from mixpinn.dataset import Split, read_positions
    from mixpinn.pipeline.config import RunConfig
    from mixpinn.serving.contact_source import read_contacts
    from mixpinn.training.history import read_history

    def settings(path: Path) -> None:
        build_config(RunConfig, read_config_file(path))

    kinds: list[tuple[str, Callable[[Path], object]]] = [
        ("c.csv", read_contacts), ("c.json", read_contacts), ("c.npz", read_contacts), ("p.txt", read_positions),
        ("n.csv", read_names), ("n.json", read_names), ("s.toml", settings), ("s.json", settings),
        ("split.json", Split.load), ("history.csv", lambda path: read_history(path.parent)),
    ]
    name, read = kinds[content[0] % len(kinds)] if content else kinds[0]
    (folder / name).write_bytes(content[1:])
    read(folder / name)


def _labels(folder: Path, content: bytes) -> None:
    from mixpinn.anatomy.images.image_file import read_label_image

    names = ("l.nii", "l.nii.gz", "l.nrrd", "l.mha")
    name = names[content[0] % len(names)] if content else names[0]
    packed = gzip.compress(content[1:], 0) if name.endswith("gz") else content[1:]
    (folder / name).write_bytes(packed)
    read_label_image(folder / name)


def _meshes(folder: Path, content: bytes) -> None:
    from mixpinn.records import TissueMesh
    from mixpinn.records.joint_frame import load_joint_frames

    if content[:1] == b"{":
        (folder / "joints.json").write_bytes(content)
        load_joint_frames(folder / "joints.json")
        return
    (folder / "mesh.vtu").write_bytes(content)
    mesh = TissueMesh.load(folder / "mesh.vtu")
    assert np.isfinite(mesh.points).all()


_bundles = BundleReader()
READERS: dict[str, Callable[[Path, bytes], None]] = {
    "tables": _tables, "labels": _labels, "meshes": _meshes, "foreign": read_foreign, "bundles": _bundles,
}


def _compiled() -> list[str]:
    """Modules with kernels, which cannot be instrumented."""
    source = ROOT / "src"
    return [
        ".".join(path.relative_to(source).with_suffix("").parts) for path in sorted(source.rglob("*.py"))
        if any(word in path.read_text(encoding="utf-8") for word in ("numba", "compiled", "inlined"))
    ]


def _in_text(mesh: bytes) -> bytes:
    """A ``.vtu`` whose numbers are text, which more alterations leave readable."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter

    reader, writer = vtkXMLUnstructuredGridReader(), vtkXMLUnstructuredGridWriter()
    reader.SetReadFromInputString(True)
    reader.SetInputString(mesh.decode("ascii"))
    reader.Update()
    writer.SetInputData(reader.GetOutput())
    writer.SetDataModeToAscii()
    writer.SetWriteToOutputString(True)
    writer.Write()
    return writer.GetOutputString().encode("ascii")


def seeds(reader: str) -> list[bytes]:
    """Small sound files to begin with."""
    if reader == "bundles":
        with tempfile.TemporaryDirectory() as folder:
            return _bundles.seeds(Path(folder))
    if reader == "foreign":
        return foreign_seeds()
    from drill.odd_files import archive, metaimage, nifti, nrrd, saved

    if reader == "labels":
        names = b'<CaretExtension><Label Key="1">vertebrae_L1</Label></CaretExtension>'
        return [
            b"\x00" + nifti(), b"\x01" + nifti(), b"\x02" + nrrd(), b"\x03" + metaimage(), b"\x01" + names,
            b"\x02" + nrrd("1 9 9 9").replace(b"dimension: 3", b"dimension: 4"),
        ]
    if reader == "meshes":
        with tempfile.TemporaryDirectory() as folder:
            sound_bundle(Path(folder))
            frame = {"first": "a", "second": "b", "origin": [0, 0, 0], "axes": np.eye(3).tolist(), "spacing": 1.0}
            mesh = (Path(folder) / "mesh.vtu").read_bytes()
            return [mesh, _in_text(mesh), json.dumps({"joints": [frame]}).encode()]
    return [
        b"\x00node,dx,dy,dz\n3,0,-1,0\n", b"\x00302.0;0,5;-1,25;0\n",
        b'\x01{"nodes": [1], "displacements": [[0, 1, 2]]}',
        b"\x02" + archive(nodes=saved([1, 2]), displacements=saved(np.ones((2, 3)))), b"\x03x y z\n0 1 2\n",
        b"\x04index,name\n1,liver\n", b'\x05{"1": "liver"}', b'\x041 0 0 0 1 1 1 "liver"\n',
        b"\x06[mesh]\nsize = 2.0\n",
        b'\x07{"mesh": {"size": 2}}', b'\x08{"train": [0], "val": [1], "test": [2]}',
        b"\x09epoch,train_loss,validation_loss,learning_rate,seconds\n1,1.0,1.0,0.1,3\n",
    ]


def main() -> None:
    """Fuzz one reader."""
    import atheris

    reader, corpus, options = sys.argv[1], Path(sys.argv[2]), sys.argv[3:]
    with atheris.instrument_imports(include=["mixpinn"], exclude=_compiled()):
        from mixpinn.base.errors import InputError

        corpus.mkdir(parents=True, exist_ok=True)
        for index, content in enumerate(seeds(reader)):
            (corpus / f"seed-{index}").write_bytes(content)
            with tempfile.TemporaryDirectory() as folder, contextlib.suppress(InputError):
                READERS[reader](Path(folder), content)
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))

    def one(content: bytes) -> None:
        from mixpinn.base import manifest

        manifest._checked.clear()
        said = ""
        try:
            READERS[reader](folder, content)
        except InputError as error:
            said = str(error)
        assert "\n" not in said

    atheris.Setup([sys.argv[0], str(corpus), "-rss_limit_mb=3000", "-timeout=20", *options], one)
    try:
        atheris.Fuzz()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
