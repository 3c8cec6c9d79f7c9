"""Coverage-guided fuzzing of the readers of foreign and own files: whatever the bytes, an answer or one line.

    python tests/drill/fuzz_readers.py READER CORPUS [options of libFuzzer, such as -max_total_time=600]

READER is one of `READERS`; CORPUS is a folder for inputs that reach new code, begun with small sound files. It needs
the extra ``fuzz`` (atheris) and is never part of the tests; what it found is kept in ``fuzz_found.py``, which is.
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


def _foreign(folder: Path, content: bytes) -> None:
    """Meshes and probes that a process of its own reads: the first byte says of which kind."""
    from mixpinn.mesh.import_vtu import import_vtu
    from mixpinn.records import Probe

    names = ("m.vtu", "m.vtk", "m.msh", "p.stl", "p.ply", "p.obj", "p.vtp")
    name = names[content[0] % len(names)] if content else names[0]
    (folder / name).write_bytes(content[1:])
    (Probe.load if name.startswith("p") else import_vtu)(folder / name)


_BUNDLE_FILES = (
    "hybrid.json", "hybrid.safetensors", "pose.safetensors", "mesh.vtu", "manifest.json", "prior/prior.json",
    "prior/compliance.npy", "prior/manifest.json",
)


def _bundles(folder: Path, content: bytes) -> None:
    """One file of a bundle: the first byte says which; its manifest is made to fit unless it is the file itself."""
    from mixpinn.serving import load_predictor
    from mixpinn.stages.seal import seal_folder

    bundle = folder / "bundle"
    if not bundle.exists():
        _sound_bundle(bundle)
    name = _BUNDLE_FILES[content[0] % len(_BUNDLE_FILES)] if content else _BUNDLE_FILES[0]
    altered = (bundle / name, bundle / "manifest.json", bundle / "prior/manifest.json")
    kept = {path: path.read_bytes() for path in altered}
    try:
        (bundle / name).write_bytes(content[1:])
        if not name.endswith("manifest.json"):
            for manifest in (bundle / "prior/manifest.json", bundle / "manifest.json"):
                manifest.unlink()
            seal_folder(bundle / "prior")
            seal_folder(bundle)
        predictor = load_predictor(bundle, threads=1, warm_up=False)
        nodes = predictor.model.prior.nodes[:3]
        answer = predictor.predict_at(nodes, np.tile([0.0, -0.5, 0.1], (len(nodes), 1)))
        assert np.isfinite(answer.displacement).all()
    finally:
        for path, sound in kept.items():
            path.write_bytes(sound)


def _sound_bundle(folder: Path) -> None:
    """A bundle of a block of 27 nodes, nothing learned."""

    from mixpinn.fem import ContactConfig, StableNeoHookean
    from mixpinn.geometry.probe_shapes import linear_probe
    from mixpinn.press.files import save_pose_model
    from mixpinn.records import TissueMesh
    from mixpinn.reduced.equilibrium import Equilibrium
    from mixpinn.reduced.hybrid import HybridModel
    from mixpinn.reduced.prior import ElasticPrior
    from mixpinn.stages.hybrid import plain_pose_model, save_bundle
    from validation.kuhn import grid_points, kuhn_cells

    axis = np.linspace(-30.0, 30.0, 4)
    points = grid_points(axis, axis, axis)
    cells = kuhn_cells((3, 3, 3))
    inside = (np.abs(points) < 11.0).all(axis=1)
    part = inside.astype(np.int16)
    cells = cells[~inside[cells].all(axis=1)].astype(np.int32)
    mesh = TissueMesh(
        points, cells, part, points[:, 1] < -29.0, ("bone",), np.zeros(len(cells), np.int16), ("soft tissue",),
    )
    materials = (StableNeoHookean(mu=8.76e-3, lam=8.47e-2),)
    prior = ElasticPrior.build(mesh, materials, nodes=np.flatnonzero(points[:, 1] > 29.0))
    model = HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, materials))
    save_bundle(model, folder)
    save_pose_model(plain_pose_model(model, linear_probe(), ContactConfig()), folder)


READERS: dict[str, Callable[[Path, bytes], None]] = {
    "tables": _tables, "labels": _labels, "meshes": _meshes, "foreign": _foreign, "bundles": _bundles,
}
def _compiled() -> list[str]:
    """Modules with kernels, which cannot be instrumented."""
    source = ROOT / "src"
    return [
        ".".join(path.relative_to(source).with_suffix("").parts) for path in sorted(source.rglob("*.py"))
        if any(word in path.read_text(encoding="utf-8") for word in ("numba", "compiled", "inlined"))
    ]


def seeds(reader: str) -> list[bytes]:
    """Small sound files to begin with."""
    if reader == "bundles":
        with tempfile.TemporaryDirectory() as folder:
            _sound_bundle(Path(folder) / "b")
            return [
                bytes([index]) + (Path(folder) / "b" / name).read_bytes() for index, name in enumerate(_BUNDLE_FILES)
            ]
    from drill.poisons import archive, grid, metaimage, nifti, nrrd, saved, stl

    if reader == "labels":
        names = b'<CaretExtension><Label Key="1">vertebrae_L1</Label></CaretExtension>'
        return [
            b"\x00" + nifti(), b"\x01" + nifti(), b"\x02" + nrrd(), b"\x03" + metaimage(), b"\x01" + names,
            b"\x02" + nrrd("1 9 9 9").replace(b"dimension: 3", b"dimension: 4"),
        ]
    if reader == "foreign":
        files = [grid(".vtu"), grid(".vtk"), grid(".msh")]
        return [*(bytes([i]) + text.encode() for i, text in enumerate(files)), b"\x03" + stl()]
    if reader == "meshes":
        with tempfile.TemporaryDirectory() as folder:
            _sound_bundle(Path(folder) / "b")
            frame = {"first": "a", "second": "b", "origin": [0, 0, 0], "axes": np.eye(3).tolist(), "spacing": 1.0}
            return [(Path(folder) / "b" / "mesh.vtu").read_bytes(), json.dumps({"joints": [frame]}).encode()]
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
