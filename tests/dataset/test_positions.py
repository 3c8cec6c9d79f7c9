from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.dataset import Protocol, grid_positions, left_at_ends, plan_poses, thin_positions
from mixpinn.dataset.positions import pressed_part
from mixpinn.records import Probe

DOWN = Protocol(start="touch", approach=0.0)


def test_grid_covers_the_rigid_parts_on_the_skin():
    # The rigid cube spans ±15 mm across a block with a flat top at y = 0: three ticks every 10 mm, centred.
    mesh = block(6)
    positions = grid_positions(mesh, DOWN)
    ticks = [-15.0, -5.0, 5.0, 15.0]
    assert sorted({x for x, _, _ in positions.tolist()}) == pytest.approx(ticks)
    assert sorted({z for _, _, z in positions.tolist()}) == pytest.approx(ticks)
    np.testing.assert_allclose(positions[:, 1], 0.0, atol=1e-9)
    assert len(positions) == 16


@pytest.mark.parametrize(("direction", "axis", "level"), [
    ((1.0, 0.0, 0.0), 0, -25.0), ((0.0, 1.0, 0.0), 1, -50.0), ((0.0, 0.0, -1.0), 2, 25.0),
])
def test_grid_lies_on_the_side_that_is_pressed(direction, axis, level):
    positions = grid_positions(block(6), Protocol(direction=direction))
    assert len(positions) == 16
    np.testing.assert_allclose(positions[:, axis], level, atol=1e-9)


def test_no_probe_hangs_over_an_end_of_the_mesh():
    # The block ends at z = ±25 mm, its bone at ±15. A plate of 24 mm that is turned by 45° reaches 17 mm to either
    # side, so that tips lie within 8 mm of the middle: over the vertices of the bone at ±5.
    mesh, turned = block(6), replace(DOWN, rotations=(0.0, 45.0))
    positions = grid_positions(mesh, turned, probe=plate(24.0))
    assert sorted({z for _, _, z in positions.tolist()}) == pytest.approx([-5.0, 5.0])
    assert sorted({x for x, _, _ in positions.tolist()}) == pytest.approx([-15.0, -5.0, 5.0, 15.0])
    assert left_at_ends(mesh, turned, plate(24.0)) == pytest.approx((12.0 * 2.0**0.5 - 10.0, 12.0 * 2.0**0.5 - 10.0))
    assert left_at_ends(mesh, DOWN, plate(4.0)) == (0.0, 0.0)
    # Where no place would be left, and where the ends themselves are pressed, nothing is left out.
    for protocol, probe in ((turned, plate(60.0)), (replace(turned, direction=(0.0, 0.0, -1.0)), plate(24.0))):
        np.testing.assert_array_equal(
            grid_positions(mesh, protocol, probe=probe), grid_positions(mesh, protocol),
        )


def test_the_part_of_a_probe_that_presses_ends_at_the_depth():
    # A cone of 45° with its apex at the tip: at a depth of 5 mm its rim has a radius of 5 mm.
    angles = np.arange(8) * np.pi / 4.0
    rim = np.column_stack([20.0 * np.cos(angles), np.full(8, 20.0), 20.0 * np.sin(angles)])
    triangles = np.array([[0, 1 + i, 1 + (i + 1) % 8] for i in range(8)])
    part = pressed_part(Probe(np.concatenate([np.zeros((1, 3)), rim]), triangles), 5.0)
    assert part[:, 1].max() == pytest.approx(5.0)
    np.testing.assert_allclose(np.linalg.norm(part[1:, [0, 2]], axis=1), 5.0)


def test_grid_without_rigid_parts_keeps_off_the_border():
    positions = grid_positions(block(4, rigid=False), DOWN)
    assert np.abs(positions[:, [0, 2]]).max() <= 5.0 + 1e-9


def test_thinning_spreads_and_keeps_order():
    line = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    assert thin_positions(line, 3)[:, 0].tolist() == [0.0, 5.0, 10.0]
    assert thin_positions(line, None) is line
    assert thin_positions(line, 20) is line


def test_planned_poses_begin_at_touch_or_as_listed():
    mesh, positions = block(), np.array([[0.0, 7.0, 0.0]])
    listed = plan_poses(positions, Protocol(), mesh=mesh, probe=plate(), gap=2.0)
    assert {pose.position for pose in listed} == {(0.0, 7.0, 0.0)}
    touching = plan_poses(positions, DOWN, mesh=mesh, probe=plate(), gap=2.0)
    assert [pose.rotation_deg for pose in touching] == [0.0, 45.0, 90.0, 135.0]
    assert all(pose.position[1] == pytest.approx(2.0, abs=2e-3) for pose in touching)


def test_bones_close_beside_the_targets_are_pressed_too():
    mesh = block(6)
    part = mesh.part.copy()
    part[mesh.points[:, 2].argmax()] = 2  # a vertex of another bone, 25 mm beside the middle of the first
    both = replace(mesh, part=part, rigid_names=(*mesh.rigid_names, "beside"), targets=mesh.rigid_names)
    assert both.pressed_points[:, 2].max() == pytest.approx(mesh.points[:, 2].max())
    far = replace(both, points=both.points * np.array([1.0, 1.0, 4.0]))
    assert far.pressed_points[:, 2].max() < far.points[:, 2].max()
