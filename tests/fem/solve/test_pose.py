"""One full solve from the pose alone: the straight path, histories, and what it says of itself."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem.block_mesh import block, labelled
from mixpinn.base.errors import InputError
from mixpinn.dataset.protocol import Protocol, probe_path
from mixpinn.fem import PoseSimulator, Scene, SolverConfig, solve_pose
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Source


def bedded() -> TissueMesh:
    """A block fixed at y = 0 with a rigid box inside."""
    mesh = block((6, 4, 6), size=(36.0, 20.0, 48.0))
    inside = (np.abs(mesh.points / (36.0, 20.0, 48.0) - 0.5) < 0.26).all(axis=1)
    return labelled(mesh.points, mesh.cells, part=inside.astype(np.int16), fixed=mesh.points[:, 1] == 0.0)


SCENE = Scene(bedded(), spherical_probe(radius=8.0, subdivisions=2), solver=SolverConfig(tolerance=1e-8, threads=1))
TOP, GAP = 20.0, 2.0
"""Height of the skin, and the distance at which contact acts [mm]: first touch lies at their sum."""


@cache
def simulator() -> PoseSimulator:
    """Prepared once for all tests."""
    return PoseSimulator(SCENE)


def press(x: float, depth: float, z: float = 24.0, **options):
    """Press straight down by `depth` [mm] beyond first touch."""
    tip = np.array([x, TOP + GAP - depth, z])
    return solve_pose(SCENE, tip, np.eye(3), simulator=simulator(), **options)


@pytest.fixture(scope="module")
def answer():
    return press(18.0, 2.4)


def test_the_path_is_straight_from_first_touch_in_steps_of_one_millimetre(answer):
    path = probe_path((18.0, TOP + GAP, 24.0), 0.0, Protocol(approach=0.0, steps=2, start="touch"))
    tip = np.array([[18.0, TOP + GAP - 2.4, 24.0]])
    by_hand = simulator().run(type(path)(
        np.concatenate([path.translations, tip]), np.tile(np.eye(3), (3, 1, 1)), np.array([1.0, 2.0, 2.4]),
    ))
    assert by_hand.converged.all()
    assert_allclose(answer.displacement, by_hand.displacement[-1], atol=1e-4)
    assert_allclose(answer.force, by_hand.probe_wrench[-1, :3], rtol=1e-3, atol=1e-4)
    assert_allclose(answer.moment, by_hand.probe_wrench[-1, 3:], rtol=1e-3, atol=1e-2)


def test_an_answer_is_in_balance_and_says_so(answer):
    assert answer.source is Source.FULL_SOLVE
    assert answer.trust.converged
    assert answer.trust.residual < 1e-8
    assert_allclose(answer.contact.forces.sum(axis=0), -answer.force, atol=1e-12)
    assert answer.force[1] > 0.0  # the tissue pushes the probe back
    assert_allclose(answer.displacement[answer.contact.nodes], answer.contact.displacement)


def test_motions_are_those_of_the_part(answer):
    mesh, (name,) = SCENE.mesh, SCENE.mesh.rigid_names
    motion, rest = answer.motions[name], mesh.points[mesh.part == 1]
    arms = rest - rest.mean(axis=0)
    assert_allclose(
        answer.displacement[mesh.part == 1], motion.translation + arms @ motion.rotation.T - arms, atol=1e-5,
    )
    assert motion.distance > 0.1


def test_a_history_continues_where_the_earlier_answer_ended(answer):
    first = press(18.0, 2.0)
    assert_allclose(press(18.0, 2.4, history=first.history).displacement, answer.displacement, atol=1e-4)
    # Dragged sideways the skin follows the probe; pressed down there afresh it does not.
    dragged, afresh = press(21.0, 2.4, history=answer.history), press(21.0, 2.4)
    assert dragged.trust.converged
    assert dragged.force[0] < -0.02
    assert abs(afresh.force[0]) < 0.2 * abs(dragged.force[0])


def test_a_probe_above_or_beside_the_skin_moves_nothing():
    for untouched in (press(18.0, -1.0), press(400.0, 3.0)):
        assert not untouched.displacement.any()
        assert not untouched.force.any()
        assert len(untouched.contact.nodes) == 0
        assert untouched.history is None


def test_a_solve_that_stops_early_says_so():
    scene = Scene(SCENE.mesh, SCENE.probe, solver=SolverConfig(max_iterations=1, max_cuts=0, tolerance=1e-13))
    stopped = solve_pose(scene, np.array([18.0, TOP, 24.0]), np.eye(3))
    assert not stopped.trust.converged
    assert not stopped.trust.sound
    assert "stopped at" in stopped.trust.reasons[0]


def test_foreign_histories_and_poses_are_refused(answer):
    other = Scene(SCENE.mesh, spherical_probe(radius=6.0, subdivisions=2))
    with pytest.raises(InputError, match="another scene"):
        solve_pose(other, np.zeros(3), np.eye(3), history=answer.history)
    with pytest.raises(InputError, match="full solve"):
        press(18.0, 1.0, history="no history")
    with pytest.raises(InputError, match="rotation matrix"):
        solve_pose(SCENE, np.zeros(3), 2.0 * np.eye(3))
    with pytest.raises(InputError, match="finite"):
        solve_pose(SCENE, np.array([np.nan, 0.0, 0.0]), np.eye(3))
