import numpy as np
from rich.console import Console

from mesh.shapes import box_mesh
from mixpinn.mesh import mesh_statistics


def test_one_hollow_cube():
    """The 8 corners of the cavity are its part; its edges are the 12 of the cube and one diagonal a face."""
    table = mesh_statistics(box_mesh((3, 3, 3), cavity=np.s_[1:2, 1:2, 1:2]))
    assert [part.points for part in table.parts] == [64 - 8, 8]
    assert table.parts[1].edges == 2 * (12 + 6)
    # Edges of the full grid: 3 · 3 · 16 along axes, 3 · 27 + 3 · 9 face diagonals, 27 inner ones; one is cut away.
    assert table.edges == 2 * (144 + 108 + 27 - 1)
    assert table.points == 64


def test_tables_show_the_totals():
    table = mesh_statistics(box_mesh((3, 3, 3), cavity=np.s_[1:2, 1:2, 1:2]))
    console = Console(width=80, record=True, quiet=False, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(table.table())
    for text in (console.export_text(), table.markdown()):
        assert "block (1)" in text
        assert str(table.edges) in text
