from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.dataset import Protocol, grid_positions, plan_poses, thin_positions

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
