"""Tables in every form that spreadsheets and programs give them: the same numbers, or a line that says why not."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.text import read_text
from mixpinn.base.text_table import read_columns

COLUMNS = {"node": ("id",), "dx": ("ux",), "dy": ("uy",), "dz": ("uz",)}
VALUES = np.array([[7.0, 0.25, -3.5, 0.0], [12.0, -1.0, 2.5e-3, 4.0]])
CSV = "node,dx,dy,dz\n7,0.25,-3.5,0\n12,-1,2.5e-3,4\n"
BODY = CSV.partition("\n")[2]


def read(tmp_path, text, encoding="utf-8"):
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    return read_columns(tmp_path / "a.csv", COLUMNS, unit="mm", expected="contacts", fix="write node,dx,dy,dz")


@pytest.mark.parametrize("text", [
    CSV, BODY, CSV.replace("\n", "\r\n"), CSV.replace("\n", "\r"), CSV.replace(",", ";"), CSV.replace(",", "\t"),
    CSV.replace(",", " "), CSV.replace(",", ";").replace(".", ","), CSV.replace(",", "\t").replace(".", ","),
    BODY.replace(",", " ").replace(".", ","), CSV + ",,,\n\n;;;\n", CSV.replace("\n", ",,\n"),
    "# contacts of pose 3\n" + CSV, "# node dx dy dz\n" + BODY, BODY.replace("7,", "7.0,").replace("12,", "1.2e+01,"),
    'Node,"dx [mm]","dy (mm)",dz\n' + BODY, "id,ux,uy,uz\n" + BODY, BODY.replace(",", " , "),
    "node,x,dx,y,dy,z,dz\n7,9,0.25,9,-3.5,9,0\n12,9,-1,9,2.5e-3,9,4\n", BODY.replace("\n", "  # note\n"),
])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_forms(tmp_path, text, encoding):
    assert np.array_equal(read(tmp_path, text, encoding), VALUES)


@pytest.mark.parametrize("mark", ["", "# "])
def test_order_is_that_of_the_names(tmp_path, mark):
    text = f"{mark}dz,dy,node,dx\n0,-3.5,7,0.25\n4,2.5e-3,12,-1\n"
    assert np.array_equal(read(tmp_path, text), VALUES)


@pytest.mark.parametrize(("text", "says"), [
    ("node,x,y,z\n7,1,2,3\n", "the columns node, dx, dy, dz, each once, got the names node, x, y, z"),
    ("node,dx,dx,dz\n7,1,2,3\n", "each once"), ("node,dx,dy,dz [m]\n7,1,2,3\n", "lengths in mm"),
    ("# node,dy,dz,weight\n7,1,2,3\n", "each once"), ("7,1,2,3,4\n", "5 columns without names"),
    ("7,1,2\n", "3 columns in line 1"), ("7,1,2,3\n8,1,2\n", "3 columns in line 2"),
    ("7,1,,3\n", "an empty cell in line 1"), ("7,1,a,3\n", "'a' in line 1"), ("node,dx,dy,dz\n", "no row"),
    ("", "no row"),
    ("7,1_0,2,3\n", "'1_0' in line 1"), (CSV + "#N/A,0,1,2\n", "'#N/A' in line 4"),
    (CSV + "7,#REF!,1,2\n", "'#REF!' in line 4"), ("#DIV/0!,0,1,2\n" + BODY, "'#DIV/0!' in line 1"),
])
def test_refusals_name_the_place(tmp_path, text, says):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert says in str(caught.value)


@pytest.mark.parametrize(("comment", "taken"), [
    ("# units: mm", True), ("# unit = Millimetres", True), ("# all lengths in mm, of the unit test", True),
    ("# unit: PROBE-3", True), ("# units: m", False), ("% Unit is cm", False), ("// units [inch]", False),
])
def test_a_unit_beside_the_numbers_counts(tmp_path, comment, taken):
    if taken:
        assert np.array_equal(read(tmp_path, f"{comment}\n{CSV}"), VALUES)
    else:
        with pytest.raises(InputError, match="lengths in mm"):
            read(tmp_path, f"{comment}\n{CSV}")


def test_text_of_any_encoding(tmp_path):
    path = tmp_path / "a.txt"
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"):
        path.write_bytes("Rücken".encode(encoding))
        assert read_text(path, expected="text") == "Rücken"
    for content in (b"\x00\x01", b"\xff\xfe\x00", bytes([0x81]) + b"x"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"a\.txt"):
            read_text(path, expected="text")
    with pytest.raises(InputError, match="no such file"):
        read_text(tmp_path / "absent", expected="text")
