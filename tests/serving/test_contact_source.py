"""Contact files of each format, and their refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.serving import read_contacts

NODES, MOVED = np.array([7, 3]), np.array([[0.0, -1.5, 0.25], [1e-3, -2.0, 0.0]])
TEXTS = {
    "with header.csv": "node,dx,dy,dz\n7,0,-1.5,0.25\n3,1e-3,-2,0\n",
    "plain.csv": "# moved by the probe\n7, 0, -1.5, 0.25\n\n3, 1e-3, -2, 0\n",
    "file.json": json.dumps({"nodes": NODES.tolist(), "displacements": MOVED.tolist()}),
}


@pytest.mark.parametrize("name", [*TEXTS, "file.npz"])
def test_each_format_is_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name in TEXTS:
        path.write_text(TEXTS[name])
    else:
        np.savez(path, nodes=NODES, displacements=MOVED)
    nodes, displacements = read_contacts(path)
    np.testing.assert_array_equal(nodes, NODES)
    np.testing.assert_array_equal(displacements, MOVED)


BAD = {
    "three columns.csv": b"1,0,0\n", "words.csv": b"node,dx,dy,dz\n1,a,b,c\n", "half.csv": b"1.5,0,0,0\n2,0,0,0\n",
    "bytes.csv": b"\xff\xfe\x00\x01", "list.json": b"[1, 2]", "cut.json": b'{"nodes": [1',
    "keys.json": b'{"nodes": [1]}',
    "metres.json": b'{"nodes": [1], "displacements": [[0, 0.001, 0]], "unit": "m"}',
    "twice.json": b'{"nodes": [1], "nodes": [2], "displacements": [[0, -1, 0]]}',
    "ragged.json": b'{"nodes": [1, 2], "displacements": [[1, 2, 3], [1]]}', "cut.npz": b"PK\x03\x04", "empty.npz": b"",
    "contacts.xlsx": b"1,0,0,0", "contacts": b"1,0,0,0",
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BAD[name])
    with pytest.raises(InputError) as raised:
        read_contacts(tmp_path / name)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("rows", [
    "0,-1,0,302\n", "0,-1,0.5,302\n1,-1,0.5,303\n", "0;302;-1,5;0\n", "5,0.5,-1,12\n", "0,-1,0,3\n",
])
def test_ids_that_may_stand_elsewhere_need_names(tmp_path: Path, rows: str) -> None:
    (tmp_path / "a.csv").write_text(rows)
    with pytest.raises(InputError, match="may hold the ids"):
        read_contacts(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("node;dx;dy;dz\n".replace(";", ";" if ";" in rows else ",") + rows)
    assert len(read_contacts(tmp_path / "a.csv")[0]) == rows.count("\n")


@pytest.mark.parametrize("rows", ["302,0,-1,0\n", "302,0,-1,0\n303,0,-1,1\n", "7,0.5,-1,0.5\n", "7 0 -1 0\n8 0 -1 0\n"])
def test_ids_that_can_only_stand_first_need_none(tmp_path: Path, rows: str) -> None:
    (tmp_path / "a.txt").write_text(rows)
    assert len(read_contacts(tmp_path / "a.txt")[0]) == rows.count("\n")


def test_units_of_an_archive_count(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", nodes=NODES, displacements=MOVED, unit="mm")
    np.testing.assert_array_equal(read_contacts(tmp_path / "a.npz")[0], NODES)
    np.savez(tmp_path / "a.npz", nodes=NODES, displacements=MOVED, unit="m")
    with pytest.raises(InputError, match="unit: expected lengths in mm"):
        read_contacts(tmp_path / "a.npz")


def test_absent_files_and_pickled_arrays_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_contacts(tmp_path / "none.csv")
    np.savez(tmp_path / "objects.npz", nodes=np.array([1, "a"], dtype=object), displacements=MOVED)
    with pytest.raises(InputError, match="contact nodes"):
        read_contacts(tmp_path / "objects.npz")
