from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.base.errors import InputError
from mixpinn.mesh.checks.condition import check_unit, frame_warnings, mesh_warnings, numbering_warnings

MESH = box_mesh(cavity=np.s_[1:3, 1:3, 1:2], spacing=30.0)
HELD = replace(MESH, fixed=MESH.points[:, 1] < -50.0)


def test_a_sound_mesh_has_no_warning():
    assert mesh_warnings(HELD) == ()
    check_unit(HELD, what="mesh.vtu")


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1e3, "micrometres")])
def test_lengths_that_are_no_millimetres(factor, unit):
    with pytest.raises(InputError, match=f"look like {unit}"):
        check_unit(replace(HELD, points=HELD.points * factor), what="mesh.vtu")


def test_centimetres_are_named():
    line, = mesh_warnings(replace(HELD, points=HELD.points * 0.1))
    assert "12 mm long: are its lengths centimetres?" in line


def test_nothing_held_and_no_rigid_part():
    assert any("no node is fixed" in line for line in mesh_warnings(MESH))
    solid = box_mesh(spacing=30.0)
    assert any("no rigid part" in line for line in mesh_warnings(replace(solid, fixed=solid.points[:, 1] < -50.0)))


@pytest.mark.parametrize("nodes", [[5], [5, 9], "a line"])
def test_what_is_held_at_a_point_or_on_a_line_can_turn(nodes):
    chosen = np.isin(np.arange(MESH.n_points), nodes)
    if nodes == "a line":
        chosen = (MESH.points[:, 1] == MESH.points[:, 1].min()) & (MESH.points[:, 2] == MESH.points[:, 2].min())
        assert chosen.sum() > 2
    line, = mesh_warnings(replace(MESH, fixed=chosen))
    assert "the body can turn" in line


def test_a_mesh_in_the_scanners_frame():
    """World: x right, y posterior, z caudal; a mesh in RAS has y and z the other way."""
    body = box_mesh(cavity=np.s_[1:3, 1:3, 1:2], spacing=30.0)
    ahead = replace(body, points=body.points + np.where(body.part > 0, 40.0, 0.0)[:, None] * [0.0, -1.0, 0.0])
    line, = frame_warnings(ahead)
    assert "in front of the body's middle" in line
    assert frame_warnings(replace(ahead, points=ahead.points * [1.0, -1.0, -1.0])) == ()
    part = np.zeros(body.n_points, dtype=body.part.dtype)
    part[body.points[:, 2].argmin()], part[body.points[:, 2].argmax()] = 1, 2
    spine = replace(body, part=part, rigid_names=("vertebrae_L2", "vertebrae_L3"))
    assert not any("feet up" in line for line in frame_warnings(spine))
    turned = replace(spine, points=spine.points * [1.0, -1.0, -1.0])
    assert any("feet up" in line for line in frame_warnings(turned))


def test_nothing_that_can_move():
    held = replace(MESH, fixed=np.ones(MESH.n_points, dtype=bool))
    assert any("every soft node is fixed" in line for line in mesh_warnings(held))
    rigid = replace(HELD, part=np.ones(MESH.n_points, dtype=HELD.part.dtype))
    assert any("no soft tissue is left" in line for line in mesh_warnings(rigid))


def test_pieces_and_doubled_points():
    far = HELD.points + np.array([500.0, 0.0, 0.0])
    two = replace(
        HELD, points=np.concatenate([HELD.points, far, HELD.points]), tissue=np.tile(HELD.tissue, 3),
        cells=np.concatenate([HELD.cells + k * HELD.n_points for k in range(3)]),
        part=np.concatenate([HELD.part, 0 * HELD.part, 0 * HELD.part]),
        fixed=np.concatenate([HELD.fixed, 0 * HELD.fixed, 0 * HELD.fixed]).astype(bool),
    )
    lines = mesh_warnings(two)
    assert any("3 pieces that are not connected" in line and "2 of them without a fixed node" in line for line in lines)
    assert any(f"{HELD.n_points} points lie at the place of another" in line for line in lines)


def renumbered(order):
    """`HELD` with its points in another order."""
    where = np.argsort(order)
    return replace(
        HELD, points=HELD.points[order], part=HELD.part[order], fixed=HELD.fixed[order],
        cells=where[HELD.cells].astype(HELD.cells.dtype),
    )


ANY = np.random.default_rng(5).permutation(HELD.n_points)
ORDERS = {
    "strewn": ANY, "as meshed": np.arange(HELD.n_points),
    "skin first": ANY[np.isin(ANY, HELD.skin_faces, invert=True).argsort(kind="stable")],
}


@pytest.mark.parametrize("order", ORDERS)
def test_a_list_from_0_is_taken_as_it_is(order):
    assert numbering_warnings(renumbered(ORDERS[order])) == ()


def test_a_list_from_1_is_told_by_edges():
    mesh = renumbered(ORDERS["skin first"])
    line, = numbering_warnings(replace(mesh, fixed=np.roll(mesh.fixed, 1)))
    assert "edges join the 25 fixed nodes" in line
    assert "counted from 1?" in line


def test_a_list_from_1_is_told_by_the_skin():
    fixed = HELD.points[:, 2] < -50.0  # numbers run along this axis
    line, = numbering_warnings(replace(HELD, fixed=np.roll(fixed, 1)))
    assert "9 of the 25 fixed nodes lie inside the body, the ones before them all on its skin" in line
