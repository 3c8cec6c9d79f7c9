"""Small files of each format, sound or with one thing in them that no honest program writes."""

import gzip
import io
import shutil
import struct
import tempfile
import zipfile
from pathlib import Path

import meshio
import nibabel as nib
import numpy as np
import pyvista as pv

NPY = "{'descr': '<f8', 'fortran_order': False, 'shape': (EXTENT,)}"


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
    folder = Path(tempfile.mkdtemp())
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
