"""Poses on cells that are refined under the probe, told on the nodes of the scene's own mesh."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from fem.block_mesh import block, labelled
from mixpinn.base.errors import InputError
from mixpinn.fem import LocalRefinement, PoseSimulator, RefinedSimulator, Scene, StableNeoHookean, solve_pose
from mixpinn.fem.local_refinement import refine_under, rim_order
from mixpinn.fem.scene_record import recorded_refinement, scene_record
from mixpinn.fem.solve.refined_pose import Injection, extrapolate
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.mesh import refine
from mixpinn.records import Probe, ProbePath, Simulation, TissueMesh

SIZE = (54.0, 24.0, 42.0)
MIDDLE = np.array([25.0, 26.0, 23.0])
"""First touch: the gap above the block, off its middle."""
TOOL = linear_probe()
TISSUE = (StableNeoHookean.from_young(25.4e-3, 0.45),)


def bed(order: int = 2, *, bone: bool = False) -> TissueMesh:
    """A block held at y = 0, with a rigid box in it if asked for."""
    mesh = block((3, 2, 3), size=SIZE)
    part = (np.abs(mesh.points / SIZE - 0.5) < 0.3).all(axis=1).astype(np.int16) if bone else None
    return labelled(mesh.points, mesh.cells, part=part, fixed=mesh.points[:, 1] == 0.0).with_order(order)


def down(depths: list[float]) -> ProbePath:
    """Straight down from first touch."""
    d = np.array(depths)
    return ProbePath(MIDDLE - d[:, None] * [0.0, 1.0, 0.0], np.tile(np.eye(3), (len(d), 1, 1)), d)


PATH = down([0.0, 1.0, 2.0])


def press(mesh: TissueMesh, refinement: LocalRefinement | None) -> Simulation:
    scene = Scene(mesh, TOOL, TISSUE, refinement=refinement)
    found = (PoseSimulator(scene) if refinement is None else RefinedSimulator(scene)).run(PATH)
    assert found.converged.all()
    return found


def test_cells_are_finer_under_the_probe_only() -> None:
    base = bed(1)
    fine = refine_under(base, TOOL, PATH, LocalRefinement(6.0, 1.0, extrapolated=False))
    assert_allclose(fine.points[: base.n_points], base.points)
    length = np.linalg.norm(np.diff(fine.points[fine.edges], axis=1)[:, 0], axis=1)
    middle = fine.points[fine.edges].mean(axis=1)
    # The probe's face is 48 mm along x and 20 mm along z at most: this far from it nothing need be longer.
    under = (np.abs(middle - MIDDLE)[:, [0, 2]] < [15.0, 4.0]).all(axis=1) & (middle[:, 1] > SIZE[1] - 1.0)
    assert under.any()
    assert length[under].max() <= 6.0 + 1e-9
    far = middle[:, 1] < 5.0
    assert length[far].max() > 15.0
    assert_allclose(fine.cell_volumes.sum(), np.prod(SIZE))


@pytest.mark.parametrize("flat", [False, True])
def test_skin_that_has_no_vertex_under_the_probe_or_lies_above_all_of_it_is_found(flat: bool) -> None:
    """A path told by its end alone, over faces larger than the probe, which may be lower than it is deep."""
    mesh = labelled(*_plain(block((1, 1, 1), size=(120.0, 60.0, 120.0))))
    tip = np.array([60.0, 48.0, 60.0])
    end = ProbePath(tip[None], np.eye(3)[None], np.array([12.0]))
    tool = Probe(TOOL.points * [1.0, 0.1, 1.0], TOOL.triangles) if flat else TOOL
    assert not flat or tool.points[:, 1].max() < 12.0
    fine = refine_under(mesh, tool, end, LocalRefinement(8.0, 1.0))
    length = np.linalg.norm(np.diff(fine.points[fine.edges], axis=1)[:, 0], axis=1)
    middle = fine.points[fine.edges].mean(axis=1)
    under = (np.abs(middle - tip)[:, [0, 2]] < [15.0, 4.0]).all(axis=1) & (middle[:, 1] > 59.0)
    assert under.sum() > 3
    assert length[under].max() <= 8.0 + 1e-9


def _plain(mesh: TissueMesh) -> tuple[np.ndarray, np.ndarray]:
    return mesh.points, mesh.cells


@pytest.mark.parametrize("order", [1, 2])
def test_forces_keep_their_resultant_and_their_virtual_work(order: int) -> None:
    base = bed(order)
    fine = refine_under(base, TOOL, PATH, LocalRefinement(6.0, 1.0, extrapolated=False))
    moved = Injection(base, fine)
    assert_allclose(fine.node_points[moved.node], base.node_points, atol=1e-9)
    skin = np.unique(fine.skin_node_faces)
    rng = np.random.default_rng(0)
    forces = np.zeros((fine.n_nodes, 3))
    forces[skin] = rng.normal(size=(len(skin), 3))
    found = moved.forces(forces)
    assert_allclose(found.sum(axis=0), forces.sum(axis=0), atol=1e-9)
    moments = (np.cross(mesh.node_points, f).sum(axis=0) for mesh, f in ((base, found), (fine, forces)))
    assert_allclose(*moments, rtol=1e-9)

    def polynomial(x: np.ndarray) -> np.ndarray:
        """One that the shape functions hold exactly."""
        flat = x @ np.array([[0.1, 0.2, -0.3], [0.4, -0.1, 0.2], [0.3, 0.1, 0.5]])
        return flat if order == 1 else flat + 0.01 * x * x[:, [1, 2, 0]]

    work = [(polynomial(mesh.node_points) * f).sum() for mesh, f in ((base, found), (fine, forces))]
    assert_allclose(*work, rtol=1e-9)


def test_force_is_that_of_a_mesh_that_is_fine_everywhere() -> None:
    coarse, local = press(bed(), None), press(bed(), LocalRefinement(9.0, 1.0, extrapolated=False))
    everywhere = press(refine(bed(1)).with_order(2), None)
    force = [found.probe_wrench[-1, 1] for found in (coarse, local, everywhere)]
    assert abs(force[0] / force[2] - 1.0) > 0.05  # something to be mended
    assert abs(force[1] / force[2] - 1.0) < 0.25 * abs(force[0] / force[2] - 1.0)
    n = bed(1).n_points
    apart = [np.linalg.norm(found.displacement[-1, :n] - everywhere.displacement[-1, :n], axis=1).mean()
             for found in (coarse, local)]
    assert apart[1] < 0.5 * apart[0]


def test_what_is_told_belongs_to_the_mesh_of_the_scene() -> None:
    mesh = bed(bone=True)
    found = press(mesh, LocalRefinement(14.0, 1.0, extrapolated=False))
    assert found.mesh_hash == mesh.hash()
    assert found.displacement.shape == (3, mesh.n_nodes, 3)
    nodes, forces = found.contacts(2)
    assert np.isin(nodes, np.unique(mesh.skin_node_faces)).all()
    assert_allclose(forces.sum(axis=0), -found.probe_wrench[2, :3], rtol=1e-9)
    # Translation and rotation are those of the bone's nodes in this mesh.
    bone = mesh.part_nodes(1)
    arm = mesh.points[bone] - mesh.points[bone].mean(axis=0)
    moved = found.part_translation[2, 0] + arm @ found.part_rotation[2, 0].T - arm
    assert_allclose(found.displacement[2, bone], moved, atol=1e-4)
    assert found.part_wrench is not None
    assert np.abs(found.part_wrench[2]).max() < 1e-2 * np.abs(found.probe_wrench[2, 1]) * 30.0


def test_one_solve_on_refined_cells() -> None:
    scene = Scene(bed(), TOOL, TISSUE, refinement=LocalRefinement(14.0, 1.0, extrapolated=False))
    tip = MIDDLE - np.array([0.0, 2.0, 0.0])
    answer = solve_pose(scene, tip, np.eye(3))
    assert answer.trust.converged
    assert "edges of 14 mm growing by 1 mm a mm, under the probe" in answer.discretisation
    assert_allclose(answer.force[1], press(bed(), scene.refinement).probe_wrench[2, 1], rtol=0.02)
    with pytest.raises(InputError, match="begin without a history"):
        solve_pose(scene, tip, np.eye(3), history=object())
    with pytest.raises(InputError, match="for each pose"):
        PoseSimulator(scene)


@pytest.mark.parametrize(("ratio", "order"), [(1.4, 1.0), (2.0, 1.0), (2.0, 2.0)])
def test_extrapolation_keeps_parts_rigid_and_forces_whole(ratio: float, order: float) -> None:
    """On made-up simulations whose error is proportional to a power of the edge, what is told has none."""
    mesh = bed(bone=True)
    path = down([0.0, 1.0])
    truth, far = made_up(mesh, path, 1.0, nodes=[3, 7]), 1.0 + 0.1 * ratio**order
    coarse = made_up(mesh, path, far, nodes=[3, 9])
    found = extrapolate(mesh, coarse, made_up(mesh, path, 1.1, nodes=[3, 7, 9]), ratio=ratio, order=order)
    assert_allclose(found.probe_wrench, truth.probe_wrench, rtol=1e-12)
    assert_allclose(found.part_translation, truth.part_translation, rtol=1e-12)
    assert_allclose(found.part_rotation, truth.part_rotation, atol=1e-12)  # turns about one axis
    assert_allclose(found.displacement, truth.displacement, atol=1e-5)
    nodes, forces = found.contacts(1, loaded=False)
    assert nodes.tolist() == [3, 7, 9]
    beyond = 1.0 / (ratio**order - 1.0)
    assert_allclose(forces.sum(axis=0), ((1.0 + beyond) * 1.1 * 3 - beyond * far * 2) * np.ones(3))
    late = made_up(mesh, path, 1.1, nodes=[3])
    late = replace(late, converged=np.array([True, False]))
    assert extrapolate(mesh, coarse, late, ratio=ratio, order=order).converged.tolist() == [True, False]


def made_up(mesh: TissueMesh, path: ProbePath, size: float, *, nodes: list[int]) -> Simulation:
    """Two steps in which everything is proportional to `size`, the turn of the rigid part too."""
    turn = Rotation.from_rotvec(size * np.array([0.0, 0.0, 0.05])).as_matrix()
    motion = size * np.array([0.1, -1.0, 0.2])
    field = np.tile(motion, (mesh.n_nodes, 1))
    bone = np.flatnonzero(mesh.node_part == 1)
    field[bone] += (mesh.node_points[bone] - mesh.points[mesh.part_nodes(1)].mean(axis=0)) @ (turn - np.eye(3)).T
    two, count = np.ones(2), len(nodes)
    return Simulation(
        mesh.hash(), 0, 0.0, path, np.tile(field, (2, 1, 1)).astype(np.float32), np.array([0, count, 2 * count]),
        np.tile(nodes, 2).astype(np.int64), np.full((2 * count, 3), size), np.full((2, 6), size),
        np.tile(turn, (2, 1, 1, 1)), np.tile(motion, (2, 1, 1)), two.astype(bool), two.astype(np.int64),
        two, two, two, two, two, None,
    )


def test_sharp_and_rounded_tools_are_told_apart() -> None:
    corners = np.array([[x, y, z] for x in (-20.0, 20.0) for y in (0.0, 30.0) for z in (-8.0, 8.0)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    box = Probe(corners, np.array([half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]))
    volume = np.linalg.det(box.points[box.triangles]).sum() / 6.0
    assert_allclose(volume, 40.0 * 30.0 * 16.0)  # the triangles face outward
    assert rim_order(box) == 1.0
    assert rim_order(linear_probe()) == rim_order(spherical_probe()) == 2.25
    # A handle with sharp edges far above the face is none of the rim.
    high = Probe(np.where(TOOL.points[:, [1]] > 20.0, [0.0, 30.0, 0.0], TOOL.points), TOOL.triangles)
    assert rim_order(high) == 2.25


def test_a_record_from_before_orders_were_told_apart_was_extrapolated_with_order_one() -> None:
    record = scene_record(Scene(bed(), TOOL, TISSUE, refinement=LocalRefinement(7.0, 0.5)))
    del record["refinement"]["order"]
    found = recorded_refinement(record)
    assert found is not None
    assert found.order == 1.0


def test_the_record_of_a_scene_names_its_refinement() -> None:
    scene = Scene(bed(), TOOL, TISSUE)
    assert "refinement" not in scene_record(scene)
    finer = replace(scene, refinement=LocalRefinement(7.0, 0.5))
    assert recorded_refinement(scene_record(finer)) == finer.refinement
    assert finer.hash() != scene.hash()
    with pytest.raises(InputError, match="edge"):
        LocalRefinement(0.0)
