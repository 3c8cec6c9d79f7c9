"""Poisons: files and settings that no honest program writes, each with its recipe in one line.

A recipe takes a `Kitchen`, makes what it needs, and says the words of the command that must refuse it.
"""

import gzip
import io
import json
import shutil
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import meshio
import nibabel as nib
import numpy as np
import pyvista as pv

from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.records import TissueMesh
from mixpinn.stages.seal import seal_folder
from pipeline.chain import Chain

Recipes = dict[str, Callable[["Kitchen"], list[object]]]
LONG = "9" * 6000
NPY = "{'descr': '<f8', 'fortran_order': False, 'shape': (EXTENT,)}"


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
        return self.predict(self.content(self.bundle, "prior/compliance.npy", change))

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


def npy(extent: str) -> bytes:
    """An array of 48 bytes of numbers whose header says another extent."""
    header = NPY.replace("EXTENT", extent).ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(48)


def archive(**arrays: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in arrays.items():
            file.writestr(f"{name}.npy", content)
    return buffer.getvalue()


def saved(array: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array), allow_pickle=True)
    return buffer.getvalue()


def bomb(size: int) -> bytes:
    """Many zeros in few bytes, after a header of NumPy that announces them."""
    buffer = io.BytesIO()
    packing = {"mode": "w", "compression": zipfile.ZIP_DEFLATED, "compresslevel": 1}
    with zipfile.ZipFile(buffer, **packing) as file, file.open("nodes.npy", "w") as out:
        out.write(npy(str(size // 8))[:-48])
        for _ in range(size >> 20):
            out.write(bytes(1 << 20))
    return buffer.getvalue()


def zeros(megabytes: int) -> bytes:
    """A gzip stream of zeros, a thousandth as long."""
    return gzip.compress(bytes(1 << 20)) * megabytes


def nifti(*, shape: tuple[int, ...] = (9, 9, 9), **header: object) -> bytes:
    """A small label map whose header says something else."""
    labels = np.zeros((9, 9, 9), np.uint8)
    labels[2:7, 2:7, 2:7] = 1
    image = nib.Nifti1Image(labels, np.diag([5.0, 5.0, 5.0, 1.0]))
    head = bytearray(image.header.binaryblock)
    head[40:56] = struct.pack("<8h", 3, *shape, 1, 1, 1, 1)
    places = {"vox_offset": 108, "scl_slope": 112, "scl_inter": 116, "srow_x": 280, "datatype": 70}
    head[108:112] = struct.pack("<f", 352.0)
    head[252:256] = struct.pack("<hh", 0, 1)
    head[280:328] = struct.pack("<12f", 5, 0, 0, 0, 0, 5, 0, 0, 0, 0, 5, 0)
    head[344:348] = b"n+1\x00"
    for name, value in header.items():
        kind = "<h" if name == "datatype" else "<f"
        head[places[name]:places[name] + struct.calcsize(kind)] = struct.pack(kind, value)
    return bytes(head) + bytes(4) + labels.tobytes(order="F")


def nrrd(sizes: str = "9 9 9", encoding: str = "raw", body: bytes = bytes(729), origin: str = "(0,0,0)") -> bytes:
    head = (
        f"NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {sizes}\n"
        f"space directions: (5,0,0) (0,5,0) (0,0,5)\nencoding: {encoding}\nspace origin: {origin}\n\n"
    )
    return head.encode() + body


def metaimage(size: str = "9 9 9", packed: bool = False, body: bytes = bytes(729)) -> bytes:
    head = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = {packed}\n"
        "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 5 5 5\n"
        f"DimSize = {size}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    )
    return head.encode() + body


def grid(suffix: str, old: str = "", new: str = "") -> str:
    """A file of tetrahedra with one thing replaced."""
    tetrahedra = pv.ImageData(dimensions=(4, 4, 4), spacing=(30.0, 30.0, 30.0)).to_tetrahedra()
    tetrahedra.clear_data()
    tetrahedra.point_data["part"] = np.zeros(64, dtype=np.int32)
    folder = Path(__import__("tempfile").mkdtemp())
    path = folder / f"x{suffix}"
    if suffix == ".msh":
        data = {"gmsh:physical": [np.ones(135, int)], "gmsh:geometrical": [np.ones(135, int)]}
        cells = {"tetra": tetrahedra.cells_dict[pv.CellType.TETRA]}
        meshio.Mesh(tetrahedra.points, cells, cell_data=data).write(path, file_format="gmsh22", binary=False)
    else:
        tetrahedra.save(path, binary=suffix == ".vtu")
    text = path.read_text()
    shutil.rmtree(folder)
    assert old in text
    return text.replace(old, new, 1)


def stl(*, count: int | None = None, first: float | None = None, scale: float = 1.0) -> bytes:
    """A binary STL of a sphere whose tip lies at the origin."""
    points = pv.Sphere(radius=15.0, center=(0.0, 15.0, 0.0), theta_resolution=8, phi_resolution=8)
    triangles = (points.points[points.regular_faces] * scale).astype("<f4")
    body = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in triangles)
    if first is not None:
        body = body[:12] + struct.pack("<f", first) + body[16:]
    return bytes(80) + struct.pack("<I", len(triangles) if count is None else count) + body


def nan(array: np.ndarray) -> np.ndarray:
    return np.full_like(array, np.nan)


def shorter(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array[:-1])


TABLES: Recipes = {
    "contacts: NaN": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n3,nan,0,0\n"),
    "contacts: infinite": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n3,0,-inf,0\n"),
    "contacts: node -1": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n-1,0,-1,0\n"),
    "contacts: node 1e30": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n1e30,0,-1,0\n"),
    "contacts: node 2.5": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n2.5,0,-1,0\n"),
    "contacts: a number of 5000 digits": lambda k: k.contacts("c.csv", f"node,dx,dy,dz\n{'9' * 5000},0,-1,0\n"),
    "contacts: twice one node": lambda k: k.contacts("c.csv", "node,dx,dy,dz\n3,0,-1,0\n3,0,-1,0\n"),
    "contacts: bytes": lambda k: k.contacts("c.csv", bytes(range(256)) * 64),
    "contacts: an open quote": lambda k: k.contacts("c.csv", 'node,dx,dy,dz\n"3,0,-1,0\n'),
    "contacts: one line of 8 MB": lambda k: k.contacts("c.csv", "1," * 4_000_000),
    "contacts: brackets without end": lambda k: k.contacts("c.json", "[" * 200_000),
    "contacts: JSON of 1e400": lambda k: k.contacts("c.json", '{"nodes": [1e400], "displacements": [[0, 0, 0]]}'),
    "contacts: JSON of a long number": lambda k: k.contacts("c.json", f'{{"nodes": [{LONG}]}}'),
    "contacts: JSON of texts": lambda k: k.contacts("c.json", '{"nodes": ["a"], "displacements": ["b"]}'),
    "contacts: JSON of uneven rows": lambda k: k.contacts("c.json", '{"nodes": [1, 2], "displacements": [[1], []]}'),
    "contacts: NPZ of 8 TB": lambda k: k.contacts("c.npz", archive(nodes=npy("10**12"), displacements=npy("6"))),
    "contacts: NPZ that claims": lambda k: k.contacts("c.npz", archive(nodes=npy("999999999999"))),
    "contacts: NPZ of objects": lambda k: k.contacts("c.npz", archive(nodes=saved(np.array([{}], object)))),
    "contacts: NPZ that unpacks to 512 MB": lambda k: k.contacts("c.npz", bomb(1 << 29)),
    "contacts: half an NPZ": lambda k: k.contacts("c.npz", archive(nodes=saved([1]), displacements=saved([[1]]))[:-30]),
    "positions: NaN": lambda k: k.simulate("--positions", k.file("p.txt", "x y z\n0 nan 0\n")),
    "positions: 1e308": lambda k: k.simulate("--positions", k.file("p.txt", "x y z\n1e308 0 0\n")),
    "positions: UTF-16 of nothing": lambda k: k.simulate("--positions", k.file("p.txt", b"\xff\xfe\x00\xd8\x00")),
    "names: twice one name": lambda k: k.named("n.json", '{"1": "a", "2": "a"}'),
    "names: huge": lambda k: k.named("n.csv", "index,name\n1e300,a\n"),
}
SETTINGS: Recipes = {
    "steps of 1e9": lambda k: k.simulate("--set", "protocol.steps=1000000000"),
    "spacing of 1e-9": lambda k: k.simulate("--set", "protocol.spacing=1e-9"),
    "rotations NaN": lambda k: k.simulate("--set", "protocol.rotations=[NaN]"),
    "friction NaN": lambda k: k.simulate("--set", "contact.friction=NaN"),
    "workers of 1.5": lambda k: k.simulate("--set", "workers=1.5"),
    "mesh of size 1e-9": lambda k: ["mesh", k.chain.anatomy, "--out", k.out, "--size", "1e-9"],
    "a million channels": lambda k: k.train("model.hidden=100000"),
    "a batch of 0": lambda k: k.train("train.batch_size=0"),
    "a phantom of a light year": lambda k: ["anatomy", "phantom", "--out", k.out, "--set", "phantom.width=1e19"],
    "a phantom of fine voxels": lambda k: ["anatomy", "phantom", "--out", k.out, "--set", "phantom.spacing=[1e-4,1,1]"],
    "TOML without end": lambda k: k.settings("r.toml", "a = " + "[" * 100_000),
    "TOML of NaN": lambda k: k.settings("r.toml", "[mesh]\nsize = nan\n"),
    "JSON without end": lambda k: k.settings("r.json", '{"a":' * 100_000),
    "JSON of a long number": lambda k: k.settings("r.json", f'{{"mesh": {{"size": {LONG}}}}}'),
    "JSON of bytes": lambda k: k.settings("r.json", "\x00\x01"),
    "a path with a zero": lambda k: k.settings("r.json", '{"anatomy": {"source": "folder", "path": "a\\u0000b"}}'),
}
JSON: Recipes = {
    "network: layers 1e9": lambda k: k.network("config", "layers", value=10**9),
    "network: layers 1000": lambda k: k.network("config", "layers", value=1000),
    "network: hidden 1e5": lambda k: k.network("config", "hidden", value=10**5),
    "network: null": lambda k: k.predict(k.content(k.chain.model, "model.json", lambda _: b"null")),
    "bundle: μ of text": lambda k: k.hybrid("mu", "soft"),
    "bundle: μ too long": lambda k: k.hybrid("mu", [1.0] * 7),
    "bundle: μ negative": lambda k: k.hybrid("mu", [-1.0]),
    "bundle: μ NaN": lambda k: k.hybrid("mu", [float("nan")]),
    "bundle: reach negative": lambda k: k.hybrid("reach", -1.0),
    "prior: nodes beyond": lambda k: k.predict(k.entry(k.bundle, "prior/prior.json", "nodes", value=[10**9])),
    "prior: nodes twice": lambda k: k.predict(k.entry(k.bundle, "prior/prior.json", "nodes", 0, value=10**4)),
    "manifest: a list": lambda k: k.predict(_unsealed(k, k.bundle, "manifest.json", b"[]")),
    "manifest: endless": lambda k: k.predict(_unsealed(k, k.bundle, "manifest.json", b"[" * 99_999)),
    "store: steps 1e9": lambda k: k.store("protocol", "steps", value=10**9),
    "store: positions NaN": lambda k: k.store("positions", 0, value=[float("nan")] * 3),
    "store: an unknown pose": lambda k: k.store("poses", 0, "position_index", value=77),
    "labels: a flat affine": lambda k: k.described("affine", 2, value=[0.0] * 4),
    "labels: too few names": lambda k: k.described("rigid_names", value=[]),
    "split: overlapping": lambda k: k.split('{"train": [0], "val": [0], "test": [1]}'),
    "split: huge": lambda k: k.split('{"train": [1e99], "val": [], "test": []}'),
    "split: null": lambda k: k.split("null"),
    "run: a list": lambda k: _run_record(k, "[]"), "run: a number": lambda k: _run_record(k, "3"),
}
ARRAYS: Recipes = {
    "prior: 8 TB": lambda k: k.prior(lambda _: npy("999999999999")),
    "prior: of objects": lambda k: k.prior(lambda _: saved(np.array([{}], object))),
    "prior: another shape": lambda k: k.prior(lambda _: saved(np.eye(3))),
    "prior: NaN": lambda k: k.prior(lambda c: c[:-4] + struct.pack("<f", np.nan)),
    "prior: half": lambda k: k.prior(lambda c: c[: len(c) // 2]),
    "bundle: modes NaN": lambda k: k.gain(np.full((5, 5), np.nan)),
    "bundle: another gain": lambda k: k.gain(np.ones((3, 4))),
    "bundle: half its tensors": lambda k: k.tensors(lambda c: c[: len(c) // 2]),
    "bundle: tensors of 8 TB": lambda k: k.tensors(lambda c: struct.pack("<Q", 1 << 43) + c[8:]),
    "network: weights NaN": lambda k: k.weights(nan),
    "network: weights of another shape": lambda k: k.weights(shorter),
    "pose: an endless field": lambda k: k.resimulated("displacement/zarr.json", lambda c: _zarr(c, 10**12)),
    "pose: a field of 50 GB": lambda k: k.resimulated("displacement/zarr.json", lambda c: _zarr(c, 10**6)),
    "pose: a step more": lambda k: k.resimulated("converged/zarr.json", lambda c: _zarr(c, 4)),
    "pose: no chunk": lambda k: k.resimulated("displacement/c/0/0/0", lambda c: b""),
    "pose: a chunk of others": lambda k: k.resimulated("displacement/c/0/0/0", lambda c: c[:8] + bytes(len(c) - 8)),
    "pose: JSON without end": lambda k: k.resimulated("zarr.json", lambda c: b"[" * 99_999),
}
MESHES: Recipes = {
    "vtu: -7 points": lambda k: k.mesh("m.vtu", grid(".vtu", 'NumberOfPoints="64"', 'NumberOfPoints="-7"')),
    "vtu: 900,000,000 points": lambda k: k.mesh("m.vtu", grid(".vtu", 'Points="64"', 'Points="900000000"')),
    "vtu: -7 cells": lambda k: k.mesh("m.vtu", grid(".vtu", 'NumberOfCells="135"', 'NumberOfCells="-7"')),
    "vtu: entities": lambda k: k.mesh("m.vtu", '<!DOCTYPE a [<!ENTITY b "' + "c" * 999 + '">]>' + grid(".vtu")),
    "vtk: 2,000,000,000 points": lambda k: k.mesh("m.vtk", grid(".vtk", "POINTS 64", "POINTS 2000000000")),
    "vtk: cells of another kind": lambda k: k.mesh("m.vtk", grid(".vtk", "CELL_TYPES 135\n10", "CELL_TYPES 135\n77")),
    "msh: 2,000,000,000 points": lambda k: k.mesh("m.msh", grid(".msh", "$Nodes\n64", "$Nodes\n2000000000")),
    "msh: nothing": lambda k: k.mesh("m.msh", ""),
    "own mesh: -7 points": lambda k: k.own_mesh(lambda c: c.replace(b'OfPoints="', b'OfPoints="-')),
    "own mesh: 10^12 cells": lambda k: k.own_mesh(lambda c: c.replace(b'OfCells="', b'OfCells="9999999999')),
    "own mesh: half": lambda k: k.own_mesh(lambda c: c[: len(c) // 2]),
    "own mesh: part 7": lambda k: k.simulate(mesh=_own(k, "part", 7)),
    "own mesh: a flat cell": lambda k: k.simulate(mesh=_own(k, "flat", 0)),
    "probe: 4,000,000,000 triangles": lambda k: k.simulate("--probe", k.file("p.stl", stl(count=4_000_000_000))),
    "probe: NaN": lambda k: k.simulate("--probe", k.file("p.stl", stl(first=np.nan))),
    "probe: infinite": lambda k: k.simulate("--probe", k.file("p.stl", stl(first=np.inf))),
    "probe: in metres": lambda k: k.simulate("--probe", k.file("p.stl", stl(scale=1e-3))),
    "probe: half": lambda k: k.simulate("--probe", k.file("p.stl", stl()[:900])),
    "probe: PLY of 10^12 points": lambda k: k.simulate("--probe", k.file("p.ply", PLY)),
}
LABELS: Recipes = {
    "nifti: 32767³ voxels": lambda k: k.labels("l.nii", nifti(shape=(32767, 32767, 32767))),
    "nifti: negative extents": lambda k: k.labels("l.nii", nifti(shape=(-9, 9, 9))),
    "nifti: data at 1e30": lambda k: k.labels("l.nii", nifti(vox_offset=1e30)),
    "nifti: data at NaN": lambda k: k.labels("l.nii", nifti(vox_offset=np.nan)),
    "nifti: slope of 1e38": lambda k: k.labels("l.nii", nifti(scl_slope=1e38, scl_inter=1.0)),
    "nifti: affine NaN": lambda k: k.labels("l.nii", nifti(srow_x=np.nan)),
    "nifti: an unknown type": lambda k: k.labels("l.nii", nifti(datatype=1234)),
    "nifti: 9³ voxels and 4 GB behind": lambda k: k.labels("l.nii.gz", gzip.compress(nifti()) + zeros(4096)),
    "nifti: half a gzip": lambda k: k.labels("l.nii.gz", gzip.compress(nifti())[:-30]),
    "nrrd: 10^18 voxels": lambda k: k.labels("l.nrrd", nrrd("1000000 1000000 1000000")),
    "nrrd: 9³ voxels and 4 GB": lambda k: k.labels("l.nrrd", nrrd(encoding="gzip", body=zeros(4096))),
    "nrrd: an origin of text": lambda k: k.labels("l.nrrd", nrrd(origin="here")),
    "mha: 10^18 voxels": lambda k: k.labels("l.mha", metaimage("1000000 1000000 1000000")),
    "mha: NaN voxels": lambda k: k.labels("l.mha", metaimage("nan 9 9")),
    "mha: packed rubbish": lambda k: k.labels("l.mha", metaimage(packed=True)),
    "own labels: 32767³ voxels": lambda k: ["mesh", k.content(k.chain.anatomy, "labels.nii.gz", _huge), "-o", k.out],
}
POISONS = {
    f"{group}: {name}": recipe
    for group, recipes in (
        ("table", TABLES), ("settings", SETTINGS), ("JSON", JSON), ("array", ARRAYS), ("mesh", MESHES),
        ("labels", LABELS),
    ) for name, recipe in recipes.items()
}
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
)


def _unsealed(k: Kitchen, source: Path, name: str, content: bytes) -> Path:
    folder = k.copy(source)
    (folder / name).write_bytes(content)
    return folder


def _run_record(k: Kitchen, text: str) -> list[object]:
    """A run directory with a record of another kind."""
    folder = k.copy(k.chain.mesh)
    (folder / "run.json").write_text(text)
    return ["mesh", k.chain.anatomy, "--config", k.chain.settings("mesh"), "--out", folder]


def _zarr(content: bytes, extent: int) -> bytes:
    told = json.loads(content)
    told["shape"][0] = extent
    return json.dumps(told).encode()


def _own(k: Kitchen, what: str, value: int) -> Path:
    folder = k.copy(k.chain.mesh)
    altered = TissueMesh.load(folder / "mesh.vtu").grid()
    if what == "flat":
        cell = altered.cells_dict[pv.CellType.TETRA][0]
        altered.points[cell[0]] = altered.points[cell[1:]].mean(axis=0)
    else:
        altered.point_data[what][0] = value
    altered.save(folder / "mesh.vtu")
    return k.seal(folder)


def _huge(content: bytes) -> bytes:
    head = bytearray(gzip.decompress(content))
    head[42:48] = struct.pack("<3h", 32767, 32767, 32767)
    return gzip.compress(bytes(head))
