import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.base.errors import InputError
from mixpinn.dataset import Protocol, first_touch, grid_positions, plan_poses, thin_positions
from mixpinn.mesh import import_vtu
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


def test_grid_without_rigid_parts_keeps_off_the_border():
    positions = grid_positions(block(4, rigid=False), DOWN)
    assert np.abs(positions[:, [0, 2]]).max() <= 5.0 + 1e-9


def test_thinning_spreads_and_keeps_order():
    line = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    assert thin_positions(line, 3)[:, 0].tolist() == [0.0, 5.0, 10.0]
    assert thin_positions(line, None) is line
    assert thin_positions(line, 20) is line


@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_flat_probe_touches_flat_skin_at_the_gap(gap):
    touch = first_touch(np.array([1.0, 40.0, 2.0]), 30.0, mesh=block(), probe=plate(), protocol=DOWN, gap=gap)
    np.testing.assert_allclose(touch, [1.0, gap, 2.0], atol=2e-3)


def test_first_touch_is_of_the_probe_and_not_of_its_tip():
    # A probe with one corner 3 mm ahead of the tip stops 3 mm earlier.
    flat = plate()
    points = flat.points.copy()
    points[0, 1] = -3.0
    touch = first_touch(
        np.zeros(3), 0.0, mesh=block(), probe=Probe(points, flat.triangles), protocol=DOWN, gap=2.0,
    )
    assert touch[1] == pytest.approx(5.0, abs=2e-3)


def test_probe_larger_than_the_body_finds_it_between_its_own_vertices():
    touch = first_touch(np.zeros(3), 0.0, mesh=block(2), probe=plate(200.0), protocol=DOWN, gap=2.0)
    assert touch[1] == pytest.approx(2.0, abs=2e-3)


def test_touch_beside_the_body_is_refused():
    with pytest.raises(InputError, match="in the probe's way"):
        first_touch(np.array([500.0, 0.0, 0.0]), 0.0, mesh=block(), probe=plate(), protocol=DOWN, gap=2.0)


def test_planned_poses_begin_at_touch_or_as_listed():
    mesh, positions = block(), np.array([[0.0, 7.0, 0.0]])
    listed = plan_poses(positions, Protocol(), mesh=mesh, probe=plate(), gap=2.0)
    assert {pose.position for pose in listed} == {(0.0, 7.0, 0.0)}
    touching = plan_poses(positions, DOWN, mesh=mesh, probe=plate(), gap=2.0)
    assert [pose.rotation_deg for pose in touching] == [0.0, 45.0, 90.0, 135.0]
    assert all(pose.position[1] == pytest.approx(2.0, abs=2e-3) for pose in touching)


def test_first_touch_foretells_the_first_loaded_step_of_recorded_poses(shared_data):
    """SOFA's probe moves by 1 mm a step: its first step with force lies 0 to 1 mm beyond first touch."""
    folder = shared_data / "patient1/paper"
    mesh = import_vtu(folder / "body.vtu", fixed=folder / "fixed.txt")
    probe = Probe.load(folder / "probe_collision.stl")
    for name in ("pose_000_000", "pose_035_090", "pose_067_045", "pose_117_135", "pose_092_000"):
        with np.load(shared_data / f"sofa/{name}.npz") as recording:
            loaded = np.flatnonzero(np.abs(recording["contact_forces_mN"]).sum(axis=1) > 0.0)[0]
            step = np.searchsorted(recording["contact_offsets"], loaded, side="right") - 1
            tips, rotation = recording["contact_probe_position"].astype(float), float(recording["rotation_deg"])
        touch = first_touch(tips[0], rotation, mesh=mesh, probe=probe, protocol=DOWN, gap=2.0)
        assert 0.0 <= touch[1] - tips[step, 1] <= 1.0
