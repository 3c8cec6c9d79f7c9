"""Pressing, dragging and withdrawing probes on small blocks."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem.block_mesh import block, labelled
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.fem import (
    PAPER_TISSUE,
    ContactConfig,
    PoseSimulator,
    Scene,
    SkinSurface,
    SolverConfig,
    StableNeoHookean,
    SuperLUSolver,
    simulate_pose,
)
from mixpinn.fem.solve.quasi_static import QuasiStaticSolver
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.records import Probe, ProbePath, Simulation, TissueMesh


def bedded(counts: tuple[int, int, int], size: tuple[float, float, float], *, bone: bool = False) -> TissueMesh:
    """A block fixed at y = 0, with a rigid box inside if asked for."""
    mesh = block(counts, size=size)
    middle = (np.abs(mesh.points / size - 0.5) < 0.26).all(axis=1)
    part = middle.astype(np.int16) if bone else None
    return labelled(mesh.points, mesh.cells, part=part, fixed=mesh.points[:, 1] == 0.0)


def plate(width: float, spacing: float) -> Probe:
    """A flat open square in y = 0 that looks downwards."""
    n = round(width / spacing)
    axis = np.linspace(-0.5 * width, 0.5 * width, n + 1)
    points = np.stack([a.ravel() for a in np.meshgrid(axis, [0.0], axis, indexing="ij")], axis=1)
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return Probe(points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), "plate")


def along(translations: FloatArray) -> ProbePath:
    """A path without rotation."""
    n = len(translations)
    return ProbePath(np.asarray(translations, dtype=np.float64), np.tile(np.eye(3), (n, 1, 1)), np.arange(n) * 1.0)


def pressing(depths: list[float], *, x: float = 20.0, z: float = 20.0, top: float = 20.0) -> ProbePath:
    """Depths below first touch, which is 2 mm over the face at height `top`."""
    return along(np.array([[x, top + 2.0 - depth, z] for depth in depths]))


SPHERE = spherical_probe(radius=8.0, subdivisions=3)
SOFT = bedded((6, 3, 6), (40.0, 20.0, 40.0))
BONY = bedded((6, 5, 6), (40.0, 30.0, 40.0), bone=True)


def test_press_and_withdraw() -> None:
    simulation = simulate_pose(
        Scene(SOFT, SPHERE), pressing([-3.0, 1.0, 2.0, 3.0, 2.0, 1.0, -1.0]), position_index=3, rotation_deg=45.0,
    )
    assert simulation.converged.all()
    assert (simulation.residual <= 1e-6).all()
    assert (simulation.position_index, simulation.rotation_deg) == (3, 45.0)
    force = simulation.probe_wrench[:, 1]
    assert force[0] == 0.0
    assert (np.diff(force[:4]) > 0.0).all()
    # Released, the body returns to rest; nothing pulls it back up.
    assert force[-1] == 0.0
    assert np.abs(simulation.displacement[-1]).max() <= 1e-5
    assert (simulation.penetration <= 0.1).all()
    assert list(simulation.sample_steps()) == [1, 2, 3, 4, 5]
    listed, loaded = simulation.contacts(3, loaded=False)[0], simulation.contacts(3)[0]
    assert set(loaded) < set(listed)
    assert (SOFT.points[listed][:, 1] == 20.0).all()


def test_forces_balance_with_a_bone_inside() -> None:
    simulator = PoseSimulator(Scene(BONY, SPHERE, solver=SolverConfig(tolerance=1e-8)))
    simulation = simulator.run(pressing([1.0, 2.5, 4.0], x=17.0, z=22.0, top=30.0))
    assert simulation.converged.all()
    system, step = simulator.system, 2
    state = system.place(
        BONY.points + simulation.displacement[step], simulation.part_rotation[step], simulation.part_translation[step],
    )
    internal = system.gradient(state)
    nodes, forces = simulation.contacts(step)
    external = np.zeros_like(internal)
    external[nodes] = -forces
    scale = np.abs(simulation.probe_wrench[step, :3]).max()
    # Displacements are stored in single precision, which leaves 1e-5 of the forces.
    assert_allclose(simulation.probe_wrench[step, :3], -forces.sum(axis=0), atol=1e-6 * scale)
    assert_allclose(internal[BONY.fixed].sum(axis=0), simulation.probe_wrench[step, :3], atol=1e-4 * scale)
    assert np.abs(system.part_wrench(internal + external, state)[0, :3]).max() <= 1e-4 * scale
    assert simulation.part_wrench is not None  # as recorded, from the configuration in double precision
    assert np.abs(simulation.part_wrench[step, 0, :3]).max() <= 1e-7 * scale
    assert np.abs(simulation.part_wrench[step, 0, 3:]).max() <= 1e-7 * scale * 10.0  # the bone's arm [mm]
    assert simulation.probe_wrench[step, 1] > 0.0
    tip = np.array([17.0, 28.0, 22.0])
    moment = np.cross(state.points[nodes] - tip, -forces).sum(axis=0)
    assert_allclose(simulation.probe_wrench[step, 3:], moment, atol=1e-4 * scale)


def test_friction_sticks_then_slides() -> None:
    friction = 0.3
    mesh = bedded((5, 4, 5), (20.0, 20.0, 20.0))
    config = ContactConfig(friction=friction, stiffness=50.0)
    down = [[11.0, 22.0 - depth, 11.0] for depth in (0.5, 1.0, 1.5)]
    drag = [[11.0 + 0.15 * k, 20.5, 11.0] for k in range(1, 25)]
    simulation = simulate_pose(Scene(mesh, plate(32.0, 2.0), contact=config), along(np.array(down + drag)),
                               position_index=0, rotation_deg=0.0)
    assert simulation.converged.all()
    tangential = np.hypot(simulation.probe_wrench[:, 0], simulation.probe_wrench[:, 2])
    normal = simulation.probe_wrench[:, 1]
    ratio = tangential / normal
    assert (ratio <= 1.01 * friction).all()
    assert_allclose(ratio[-5:], friction, rtol=0.01)
    # While it sticks, the top follows the plate.
    top = np.isclose(mesh.points[:, 1], 20.0)
    middle = top & (np.abs(mesh.points[:, [0, 2]] - 10.0).max(axis=1) < 5.0)
    followed = simulation.displacement[:, middle, 0].mean(axis=1)
    assert followed[4] - followed[2] == pytest.approx(0.3, rel=0.03)
    assert ratio[3] < ratio[4] < ratio[5] < 0.8 * friction
    assert followed[-1] - followed[-3] < 0.03


def test_a_narrow_probe_does_not_pass_between_coarse_nodes() -> None:
    coarse = bedded((3, 2, 3), (40.0, 20.0, 40.0))
    needle = spherical_probe(radius=2.0, subdivisions=2)
    simulation = simulate_pose(Scene(coarse, needle), pressing([1.0, 2.0, 3.0, 4.0, 5.0], x=18.0, z=24.0),
                               position_index=0, rotation_deg=0.0)
    assert simulation.converged.all()
    assert simulation.penetration.max() <= 0.1
    assert (np.diff(simulation.probe_wrench[:, 1]) > 0.0).all()


def test_an_embedded_skin_carries_the_load() -> None:
    corners = np.array([[5.0, 20.0, 5.0], [35.0, 20.0, 5.0], [35.0, 20.0, 35.0], [5.0, 20.0, 35.0], [20.0, 20.0, 20.0]])
    faces = np.array([[1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]])
    skin = SkinSurface.embedded(SOFT, corners - np.array([0.0, 0.2, 0.0]), faces)
    simulation = simulate_pose(Scene(SOFT, SPHERE, skin=skin), pressing([1.0, 2.0], x=18.0, z=22.0, top=19.8),
                               position_index=0, rotation_deg=0.0)
    assert simulation.converged.all()
    assert simulation.probe_wrench[1, 1] > simulation.probe_wrench[0, 1] > 0.0
    nodes, forces = simulation.contacts(1)
    assert_allclose(forces.sum(axis=0), -simulation.probe_wrench[1, :3], rtol=1e-6)
    assert np.isin(nodes, np.unique(skin.nodes)).all()


def test_the_force_of_a_sphere_comes_down_to_hertz_as_the_mesh_is_refined() -> None:
    # Indentation of a half-space by a sphere: F = 4/3 E/(1 − ν²) √R d^1.5 (K. L. Johnson, Contact Mechanics, 1985).
    radius, depths = 25.0, [1.0, 3.0]
    mu, lam = 1e-2, 1e-2  # compressible, so that linear tetrahedra do not lock
    young, poisson = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
    # The skin meets a sphere that is larger by the gap.
    hertz = 4.0 / 3.0 * young / (1.0 - poisson**2) * np.sqrt(radius + 2.0) * np.array(depths) ** 1.5
    forces = []
    for n in (6, 12, 18):
        scene = Scene(
            bedded((n, n // 2, n), (90.0, 45.0, 90.0)), spherical_probe(radius=radius, subdivisions=4),
            (StableNeoHookean(mu=mu, lam=lam),), ContactConfig(friction=0.0, spacing=3.0),
        )
        pressed = simulate_pose(scene, pressing(depths, x=45.0, z=45.0, top=45.0), position_index=0, rotation_deg=0.0)
        assert pressed.converged.all()
        forces.append(pressed.probe_wrench[:, 1])
    error = np.array(forces)[:, 1] / hertz[1] - 1.0
    assert (np.diff(error) < 0.0).all()
    assert 0.0 < error[-1] < 0.6  # the bed is 45 mm thick and its nodes 5 mm apart
    assert np.log(forces[-1][1] / forces[-1][0]) / np.log(3.0) == pytest.approx(1.5, abs=0.2)


def test_superlu_gives_the_same_answer() -> None:
    scene, path = Scene(SOFT, SPHERE, solver=SolverConfig(tolerance=1e-8)), pressing([1.0, 2.0], x=18.0, z=22.0)
    default, fallback = PoseSimulator(scene).run(path), PoseSimulator(scene, linear=SuperLUSolver()).run(path)
    assert fallback.converged.all()
    assert_allclose(fallback.displacement, default.displacement, atol=1e-5)
    assert_allclose(fallback.probe_wrench, default.probe_wrench, atol=1e-6)


def test_the_result_does_not_depend_on_poses_before() -> None:
    scene, path = Scene(SOFT, SPHERE), pressing([1.0, 2.0])
    simulator = PoseSimulator(scene)
    first = simulator.run(path)
    simulator.run(pressing([2.0], x=12.0))
    again = simulator.run(path)
    for name, array in first.arrays().items():
        if name != "seconds":
            np.testing.assert_array_equal(array, getattr(again, name, array), err_msg=name)


def test_a_long_step_is_divided() -> None:
    scene = Scene(SOFT, SPHERE, contact=ContactConfig(friction=0.0))
    at_once = simulate_pose(scene, pressing([-3.0, 3.0]), position_index=0, rotation_deg=0.0)
    slowly = simulate_pose(scene, pressing([-3.0, 0.0, 1.0, 2.0, 3.0]), position_index=0, rotation_deg=0.0)
    assert at_once.converged.all()
    assert_allclose(at_once.displacement[-1], slowly.displacement[-1], atol=1e-4)


def test_a_step_that_cannot_converge_is_reported() -> None:
    scene = Scene(SOFT, SPHERE, solver=SolverConfig(max_iterations=1, max_cuts=1, tolerance=1e-13))
    simulation = simulate_pose(scene, pressing([-1.0, 2.0, 3.0]), position_index=0, rotation_deg=0.0)
    assert list(simulation.converged) == [True, False, False]
    assert simulation.residual[1] > 1e-13
    assert not simulation.displacement[1:].any()
    assert len(simulation.sample_steps()) == 0


def test_a_step_without_solution_close_by_is_taken_with_points_that_give_way(monkeypatch) -> None:
    scene = Scene(SOFT, SPHERE, contact=ContactConfig(friction=0.5))
    path = pressing([-1.0, 0.5, 1.0])
    usual = simulate_pose(scene, path, position_index=0, rotation_deg=0.0)
    solve, asked = QuasiStaticSolver.solve, []

    def fails_where_points_stick(self, *args, stick=1.0):  # as where Coulomb's law has no solution
        asked.append(stick)
        found = solve(self, *args, stick=stick)
        return dataclasses.replace(found, converged=False) if stick == 1.0 and len(asked) > 1 else found

    monkeypatch.setattr(QuasiStaticSolver, "solve", fails_where_points_stick)
    found = simulate_pose(dataclasses.replace(scene), path, position_index=0, rotation_deg=0.0)
    assert found.converged.all()
    assert min(asked) < 1.0
    assert_allclose(found.probe_wrench[:, 1], usual.probe_wrench[:, 1], rtol=0.02)


@pytest.mark.parametrize("depth", [3.0, 8.0])
def test_a_start_inside_is_refused(depth: float) -> None:
    with pytest.raises(InputError, match="begins outside"):
        simulate_pose(Scene(SOFT, SPHERE), pressing([depth]), position_index=0, rotation_deg=0.0)


def test_steps_are_reported_as_they_finish() -> None:
    seen: list[int] = []
    simulation = simulate_pose(Scene(SOFT, SPHERE), pressing([-1.0, 0.5]), position_index=0, rotation_deg=0.0,
                               on_step=seen.append)
    assert isinstance(simulation, Simulation)
    assert seen == [0, 1]


def test_the_scenes_identity_is_that_of_what_decides_the_result() -> None:
    scene = Scene(SOFT, SPHERE)
    assert scene.hash() == Scene(SOFT, SPHERE, solver=SolverConfig(threads=2)).hash()
    assert scene.hash() != dataclasses.replace(scene, contact=ContactConfig(friction=0.5)).hash()
    with pytest.raises(InputError, match="one material"):
        Scene(SOFT, SPHERE, materials=(PAPER_TISSUE, StableNeoHookean(mu=1.0, lam=1.0)))


def test_quadratic_cells_answer_softer_than_linear_ones_and_record_their_nodes():
    """A probe on a coarse, nearly incompressible block: linear cells lock, and one row a node is recorded."""
    mesh = block((4, 2, 4), size=(80.0, 40.0, 80.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9)
    rotation, depths = np.eye(3), np.array([0.0, 1.0, 2.0])
    tips = np.array([40.0, 42.0, 40.0]) - depths[:, None] * [0.0, 1.0, 0.0]
    path = ProbePath(tips, np.tile(rotation, (3, 1, 1)), depths)
    material, simulations = StableNeoHookean.from_young(25.4e-3, 0.49), []
    for order in (1, 2):
        scene = Scene(mesh.with_order(order), linear_probe(), (material,), ContactConfig())
        simulations.append(PoseSimulator(scene).run(path))
        assert simulations[-1].converged.all()
        assert simulations[-1].mesh_hash == scene.mesh.hash()
    linear, quadratic = simulations
    assert quadratic.displacement.shape[1] == mesh.with_order(2).n_nodes
    assert 0.0 < quadratic.probe_wrench[-1, 1] < linear.probe_wrench[-1, 1]
    nodes, forces = quadratic.contacts(2)
    assert (nodes < mesh.n_points).any()
    assert (nodes >= mesh.n_points).any()
    np.testing.assert_allclose(-forces.sum(axis=0), quadratic.probe_wrench[-1, :3], atol=1e-6)
