"""What cells along the border of the held skin miss, against solves on cells that are finer there."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from fem.block_mesh import block, labelled
from mixpinn.base.errors import InputError
from mixpinn.fem import LocalRefinement, RefinedSimulator, Scene, StableNeoHookean
from mixpinn.fem.scene_record import recorded_refinement, scene_record
from mixpinn.fem.solve.held_border import HeldBorder, held_border
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.mesh import refine_to
from mixpinn.records import ProbePath, Simulation, TissueMesh

SIZE = (90.0, 60.0, 70.0)
DEPTHS = np.array([0.0, 1.0, 2.0, 3.0])
PATH = ProbePath(
    np.array([43.0, 62.0, 37.0]) - DEPTHS[:, None] * [0.0, 1.0, 0.0], np.tile(np.eye(3), (4, 1, 1)), DEPTHS,
)
PLAIN = LocalRefinement(14.0, 1.0, held=None)


def bed() -> TissueMesh:
    """A block with a rigid box in it, held at two fifths of its bottom."""
    mesh = block((5, 3, 4), size=SIZE)
    part = np.asarray((np.abs(mesh.points / SIZE - 0.5) < 0.3).all(axis=1), dtype=np.int16)
    held = (mesh.points[:, 1] == 0.0) & (mesh.points[:, 0] < 40.0)
    return labelled(mesh.points, mesh.cells, part=part, fixed=held).with_order(2)


def scene(mesh: TissueMesh, refinement: LocalRefinement | None = PLAIN) -> Scene:
    return Scene(mesh, linear_probe(), (StableNeoHookean.from_young(25.4e-3, 0.45),), refinement=refinement)


@pytest.fixture(scope="module")
def plain() -> Simulation:
    found = RefinedSimulator(scene(bed())).run(PATH)
    assert found.converged.all()
    return found


def test_the_border_is_where_held_faces_end() -> None:
    at = held_border(bed())
    assert_allclose(at[:, 1], 0.0)
    assert (at[:, 0] <= 36.0 + 1e-9).all()
    on_line = (np.abs(at[:, [0, 0, 2, 2]] - [0.0, 36.0, 0.0, 70.0]) < 1e-9).any(axis=1)
    assert on_line.all()
    assert np.abs(at[:, 0] - 36.0).min() < 1e-9  # where it ends on the bottom
    assert not len(held_border(replace(bed(), fixed=np.zeros(bed().n_points, dtype=bool))))


def test_a_corrected_pose_is_what_finer_cells_along_the_border_tend_to(plain: Simulation) -> None:
    mesh = bed()
    tree, n = cKDTree(held_border(mesh)), mesh.n_points
    solved = {}
    for edge in (6.0, 3.0):
        finer = refine_to(mesh.with_order(1), lambda points, e=edge: e + tree.query(points)[0])  # type: ignore[misc]
        solved[edge] = RefinedSimulator(scene(finer.with_order(2))).run(PATH)
    corrected = HeldBorder(scene(mesh), 3.0).corrected(plain)

    def far(one: Simulation) -> tuple[float, float, float]:
        """How far force, motion of the box and field of a simulation are from the extrapolated ones."""
        told = [(some.probe_wrench[-1, 1], some.part_translation[-1], some.displacement[-1][:n].astype(np.float64))
                for some in (one, solved[3.0], solved[6.0])]
        force, moved, field = (own - (2.0 * fine - coarse) for own, fine, coarse in zip(*told, strict=True))
        return abs(float(force)), float(np.linalg.norm(moved)), float(np.linalg.norm(field, axis=1).mean())

    left = np.array(far(corrected)) / far(plain)
    assert left[0] < 0.35
    assert left[1] < 0.15
    assert left[2] < 0.6  # the skin beside the probe slides, which the correction knows nothing of


def test_contact_stays_where_the_probe_is_and_forces_stay_in_balance(plain: Simulation) -> None:
    mesh = bed()
    found = HeldBorder(scene(mesh), 6.0).corrected(plain)
    nodes, force = plain.contacts(3, loaded=False)
    moved = (found.displacement[3] - plain.displacement[3])[nodes]
    weight = np.linalg.norm(force, axis=1) / np.linalg.norm(force, axis=1).sum()
    assert np.abs(found.displacement[3] - plain.displacement[3]).max() > 0.01
    assert_allclose(weight @ moved[:, 1], 0.0, atol=1e-5)
    assert_allclose(found.contacts(3, loaded=False)[1].sum(axis=0), -found.probe_wrench[3, :3], atol=1e-9)
    box = mesh.part == 1
    apart = found.displacement[3][: mesh.n_points][box] + mesh.points[box]
    assert_allclose(
        np.linalg.norm(apart - apart[0], axis=1), np.linalg.norm(mesh.points[box] - mesh.points[box][0], axis=1),
        atol=1e-5,
    )
    assert_allclose(found.displacement[3][: mesh.n_points][mesh.fixed], 0.0)
    assert_allclose(found.displacement[0], plain.displacement[0], atol=1e-12)  # not touched yet


def test_a_pose_is_corrected_where_the_refinement_says_so(plain: Simulation) -> None:
    by_pose = RefinedSimulator(scene(bed(), replace(PLAIN, held=6.0))).run(PATH)
    expected = HeldBorder(scene(bed()), 6.0).corrected(plain)
    assert_allclose(by_pose.displacement, expected.displacement, atol=1e-6)
    with pytest.raises(InputError, match="held"):
        LocalRefinement(held=0.0)


def test_a_record_from_before_borders_were_corrected_has_none() -> None:
    record = scene_record(scene(bed(), LocalRefinement(14.0, 1.0)))
    del record["refinement"]["held"]
    found = recorded_refinement(record)
    assert found is not None
    assert found.held is None
