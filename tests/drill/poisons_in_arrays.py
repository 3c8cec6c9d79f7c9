"""Poisons in arrays, meshes, probes and label maps."""

import gzip
import json
import struct

import numpy as np

from drill.kitchen import Recipes
from drill.odd_files import grid, metaimage, nifti, npy, nrrd, saved, stl, zeros

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
)


def nan(array: np.ndarray) -> np.ndarray:
    return np.full_like(array, np.nan)


def shorter(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array[:-1])


def _zarr(content: bytes, extent: int) -> bytes:
    told = json.loads(content)
    told["shape"][0] = extent
    return json.dumps(told).encode()


def _huge(content: bytes) -> bytes:
    head = bytearray(gzip.decompress(content))
    head[42:48] = struct.pack("<3h", 32767, 32767, 32767)
    return gzip.compress(bytes(head))


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
    "own mesh: part 7": lambda k: k.simulate(mesh=k.own("part", 7)),
    "own mesh: a flat cell": lambda k: k.simulate(mesh=k.own("flat", 0)),
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
