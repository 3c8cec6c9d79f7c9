"""The kitchen of poisons: sound artefacts, ways to alter them as a careful vandal would, and the commands to try."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from drill.odd_files import nifti
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.records import TissueMesh
from mixpinn.stages.seal import seal_folder
from pipeline.chain import Chain

Recipes = dict[str, Callable[["Kitchen"], list[object]]]
"""By name, what makes a poison and says the words of the command that must refuse it."""


@dataclass(frozen=True)
class Kitchen:
    """Sound artefacts to copy, and a folder to work in."""

    chain: Chain
    bundle: Path
    place: Path

    @property
    def out(self) -> Path:
        return self.place / "out"

    def file(self, name: str, content: bytes | str) -> Path:
        path = self.place / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def copy(self, folder: Path) -> Path:
        shutil.copytree(folder, self.place / "copy")
        return self.place / "copy"

    def seal(self, folder: Path) -> Path:
        """Vouch for altered files, as a careful vandal would."""
        for path in folder.rglob("*manifest.json"):
            path.unlink()
        for part in [path for path in folder.rglob("*") if path.is_dir() and path.name == "prior"]:
            seal_folder(part)
        seal_folder(folder)
        return folder

    def entry(self, source: Path, name: str, *keys: str | int, value: object) -> Path:
        """A sealed copy of a folder in whose JSON file one entry is another one."""
        folder = self.copy(source)
        whole = entry = json.loads((folder / name).read_text())
        for key in keys[:-1]:
            entry = entry[key]
        entry[keys[-1]] = value
        (folder / name).write_text(json.dumps(whole))
        return self.seal(folder)

    def content(self, source: Path, name: str, content: Callable[[bytes], bytes]) -> Path:
        """A sealed copy of a folder with another content of one file."""
        folder = self.copy(source)
        (folder / name).write_bytes(content((folder / name).read_bytes()))
        return self.seal(folder)

    def arrays(self, source: Path, name: str, **changed: Callable[[np.ndarray], np.ndarray]) -> Path:
        """A sealed copy of a folder with other arrays in a safetensors file, whose checksum fits."""
        folder = self.copy(source)
        arrays, about = read_arrays(folder / name)
        write_arrays(folder / name, arrays | {key: change(arrays[key]) for key, change in changed.items()}, about=about)
        return self.seal(folder)

    def prior(self, change: Callable[[bytes], bytes]) -> list[object]:
        """A prediction of a bundle with another compliance."""
        return self.predict(self.content(self.bundle, "prior/exact.npy", change))

    def tensors(self, change: Callable[[bytes], bytes]) -> list[object]:
        """A prediction of a bundle with other tensors, whose own checksum need not fit."""
        return self.predict(self.content(self.bundle, "hybrid.safetensors", change))

    def gain(self, array: np.ndarray) -> list[object]:
        """A prediction of a bundle with another regression."""
        return self.predict(self.arrays(self.bundle, "hybrid.safetensors", gain=lambda _: array.astype(np.float32)))

    def weights(self, change: Callable[[np.ndarray], np.ndarray]) -> list[object]:
        """A prediction of a network one of whose weights is another."""
        name = "weights.safetensors"
        arrays, _ = read_arrays(self.chain.model / name)
        first = next(key for key in sorted(arrays) if key.startswith("network.") and arrays[key].ndim == 2)
        return self.predict(self.arrays(self.chain.model, name, **{first: change}))

    def network(self, *keys: str, value: object) -> list[object]:
        return self.predict(self.entry(self.chain.model, "model.json", *keys, value=value))

    def hybrid(self, key: str, value: object) -> list[object]:
        return self.predict(self.entry(self.bundle, "hybrid.json", key, value=value))

    def store(self, *keys: str | int, value: object) -> list[object]:
        return self.dataset(self.entry(self.chain.simulation / "store", "store.json", *keys, value=value))

    def described(self, *keys: str | int, value: object) -> list[object]:
        """The mesh of a label map with another description."""
        return ["mesh", self.entry(self.chain.anatomy, "labels.json", *keys, value=value), "--out", self.out]

    def split(self, text: str) -> list[object]:
        return ["dataset", self.chain.simulation, "--split", self.file("s.json", text)]

    def own(self, what: str, value: int) -> Path:
        """A sealed copy of the mesh folder whose mesh has a flat cell, or another first value of its point data."""
        folder = self.copy(self.chain.mesh)
        altered = TissueMesh.load(folder / "mesh.vtu").grid()
        if what == "flat":
            cell = altered.cells_dict[pv.CellType.TETRA][0]
            altered.points[cell[0]] = altered.points[cell[1:]].mean(axis=0)
        else:
            altered.point_data[what][0] = value
        altered.save(folder / "mesh.vtu")
        return self.seal(folder)

    def own_mesh(self, change: Callable[[bytes], bytes]) -> list[object]:
        return self.simulate(mesh=self.content(self.chain.mesh, "mesh.vtu", change))

    # Words of the commands that read what was made.

    def contacts(self, name: str, content: bytes | str) -> list[object]:
        return ["predict", self.chain.model, "--contacts", self.file(name, content), "--out", self.out / "p.vtu"]

    def predict(self, model: Path) -> list[object]:
        sound = self.file("contacts.csv", "node,dx,dy,dz\n0,0,-1,0\n")
        return ["predict", model, "--contacts", sound, "--out", self.out / "p.vtu"]

    def simulate(self, *words: object, mesh: Path | None = None) -> list[object]:
        settings = ["--config", self.chain.settings("simulate")]
        return ["simulate", mesh or self.chain.mesh, *settings, "--out", self.out, *words]

    def dataset(self, store: Path) -> list[object]:
        return ["dataset", store]

    def mesh(self, name: str, content: bytes | str) -> list[object]:
        return ["mesh", self.file(name, content), "--out", self.out]

    def labels(self, name: str, content: bytes | str) -> list[object]:
        return ["anatomy", self.file(name, content), "--out", self.out, "--set", 'accept=["scale"]']

    def train(self, setting: str) -> list[object]:
        return ["train", self.chain.simulation, "--out", self.out, "--set", setting]

    def named(self, name: str, content: str) -> list[object]:
        return [*self.labels("l.nii", nifti()), "--names", self.file(name, content)]

    def settings(self, name: str, content: str) -> list[object]:
        return ["run", self.file(name, content), "--out", self.out]

    def resimulated(self, name: str, content: Callable[[bytes], bytes]) -> list[object]:
        """The verb `dataset` on a store in whose first pose a file is another one; sizes are told as they are."""
        folder = self.copy(self.chain.simulation)
        pose = sorted(path for path in (folder / "store").glob("pose_*"))[0]
        path = pose / name
        path.write_bytes(content(path.read_bytes()))
        status = folder / "store" / "status" / f"{pose.name}.json"
        told = json.loads(status.read_text())
        told["files"][name] = path.stat().st_size
        del told["sha256"]
        status.write_text(json.dumps(told))
        return self.dataset(folder)
