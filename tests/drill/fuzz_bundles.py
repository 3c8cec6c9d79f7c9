"""Fuzzing of bundles as a careful vandal alters them: checksums fit, so that what stands behind them is reached.

An input is one byte that says which file, and its content: the bytes themselves, or for files of arrays a JSON that
says type and shape of each and what stands beside them.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from unittest import mock

import numpy as np

from drill.fuzz_foreign import KINDS

_BYTES = (
    "hybrid.json", "mesh.vtu", "prior/prior.json", "prior/exact.npy", "manifest.json", "prior/manifest.json",
    "prior/near.npy", "hybrid.safetensors", "prior/far.npy", "prior/cluster.npy", "prior/close.npy", "prior/modes.npy",
    "prior/left.npy", "prior/near_scale.npy", "prior/far_scale.npy",
)
FIRST_DESCRIBED = len(_BYTES)
"""Number of the first file that is described; those before are bytes."""
_DESCRIBED = ("hybrid.safetensors", "pose.safetensors")
_LARGEST = 100_000
"""Numbers in an array of a described file."""


def sound_bundle(folder: Path) -> None:
    """A bundle of a block of 56 nodes, nothing learned."""
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


class BundleReader:
    """Reads a bundle in which one file is another one; everything that the others need is read once."""

    def __init__(self) -> None:
        self._sound: dict[str, bytes] = {}
        self._mesh = None
        self._arrays: dict[str, tuple[Mapping[str, np.ndarray], object]] = {}

    def seeds(self, folder: Path) -> list[bytes]:
        """The sound files."""
        self._prepare(folder / "bundle")
        raw = [bytes([index]) + self._sound[name] for index, name in enumerate(_BYTES)]
        described = []
        for index, (arrays, about) in enumerate(self._arrays.values(), start=len(_BYTES)):
            told = {name: [array.dtype.name, list(array.shape)] for name, array in arrays.items()}
            described.append(bytes([index]) + json.dumps({"about": about, "arrays": told}).encode())
        return raw + described

    def __call__(self, folder: Path, content: bytes) -> None:
        from mixpinn.base.manifest import Artefact
        from mixpinn.reduced.prior import ElasticPrior
        from mixpinn.serving import load_predictor

        bundle = folder / "bundle"
        if not bundle.exists():
            self._prepare(bundle)
        kind = content[0] % (len(_BYTES) + len(_DESCRIBED)) if content else 0
        name = (*_BYTES, *_DESCRIBED)[kind]
        path = bundle / name
        try:
            if kind < len(_BYTES):
                path.write_bytes(_vouched(name, content[1:]))
            else:
                self._write(path, content[1:])
            if name.startswith("prior/manifest"):  # that of the bundle would hide it
                ElasticPrior.load(path.parent, self._mesh)
                return
            if name.endswith("manifest.json"):
                predictor = load_predictor(bundle, threads=1, warm_up=False)
            else:  # manifests would hide what stands behind them
                with mock.patch.object(Artefact, "check", return_value=None):
                    mesh = None if name == "mesh.vtu" else self._mesh
                    predictor = load_predictor(bundle, mesh=mesh, threads=1, warm_up=False)
            nodes = predictor.model.prior.nodes[:3]
            answers = [predictor.predict_at(nodes, np.tile([0.0, -0.5, 0.1], (len(nodes), 1)))]
            if name.startswith("pose"):
                answers.append(predictor.press((0.0, 28.0, 0.0)))
            assert all(np.isfinite(answer.displacement).all() for answer in answers)
        finally:
            path.write_bytes(self._sound[name])

    def _prepare(self, bundle: Path) -> None:
        """Write the sound bundle, which is made once: its manifests fit no other one."""
        from mixpinn.base.tensor_file import read_arrays
        from mixpinn.records import TissueMesh

        if not self._sound:
            sound_bundle(bundle)
            self._sound = {name: (bundle / name).read_bytes() for name in {*_BYTES, *_DESCRIBED}}
            self._mesh = TissueMesh.load(bundle / "mesh.vtu")
            self._arrays = {name: read_arrays(bundle / name) for name in _DESCRIBED}
        (bundle / "prior").mkdir(parents=True, exist_ok=True)
        for name, content in self._sound.items():
            (bundle / name).write_bytes(content)

    def _write(self, path: Path, content: bytes) -> None:
        """A file of arrays as `content` describes it, with the numbers of the sound one."""
        from mixpinn.base.tensor_file import write_arrays

        try:
            told = json.loads(content)
            arrays = {
                str(name): _array(self._arrays[path.name][0].get(name), kind, shape)
                for name, (kind, shape) in told["arrays"].items()
            }
            write_arrays(path, arrays, about=told["about"])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError):
            return  # it describes nothing


def _array(sound: "np.ndarray | None", kind: str, shape: list[int]) -> np.ndarray:
    if kind not in KINDS or not 0 <= np.prod([float(extent) for extent in shape]) <= _LARGEST:
        raise ValueError
    if sound is not None and list(sound.shape) == shape:
        return sound.astype(kind)
    return np.resize(np.zeros(1) if sound is None else sound, shape).astype(kind)


def _vouched(name: str, content: bytes) -> bytes:
    """The content with checksums that fit it, where it is whole enough to have some."""
    mend: Callable[[bytes], bytes] | None = {".json": _vouched_json, ".safetensors": _vouched_tensors}.get(
        Path(name).suffix,
    )
    try:
        return content if mend is None else mend(content)
    except Exception:
        return content


def _vouched_json(content: bytes) -> bytes:
    from mixpinn.base.checksum import with_checksum

    values = json.loads(content)
    if "sha256" not in values:
        return content
    del values["sha256"]
    return json.dumps(with_checksum(values)).encode()


def _vouched_tensors(content: bytes) -> bytes:
    from safetensors.numpy import load

    from mixpinn.base.tensor_file import _checksum

    length = int.from_bytes(content[:8], "little")
    head = json.loads(content[8:8 + length])
    head["__metadata__"]["sha256"] = _checksum(load(content), head["__metadata__"]["about"])
    told = json.dumps(head).encode()
    return len(told).to_bytes(8, "little") + told + content[8 + length:]
