"""Poisons in text: tables, settings and JSON."""

from pathlib import Path

import numpy as np

from drill.kitchen import Kitchen, Recipes
from drill.odd_files import archive, bomb, npy, saved

LONG = "9" * 6000

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
    "bundle: near cells at a negative length": lambda k: k.hybrid("near", -1.0),
    "bundle: near cells of text": lambda k: k.hybrid("near", "far"),
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


def _unsealed(k: Kitchen, source: Path, name: str, content: bytes) -> Path:
    folder = k.copy(source)
    (folder / name).write_bytes(content)
    return folder


def _run_record(k: Kitchen, text: str) -> list[object]:
    """A run directory with a record of another kind."""
    folder = k.copy(k.chain.mesh)
    (folder / "run.json").write_text(text)
    return ["mesh", k.chain.anatomy, "--config", k.chain.settings("mesh"), "--out", folder]
