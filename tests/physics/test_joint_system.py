"""Joints assembled with the elastic body: derivatives, limits, condensation by hand, a chain in closed form."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from fem.block_mesh import two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem import (
    ElasticSystem,
    Joint,
    JointFrame,
    LinearBushing,
    LinearElastic,
    NeutralZoneBushing,
    Scene,
    StableNeoHookean,
    SuperLUSolver,
)
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.physics.joint_system import JointSystem
from validation.newton import equilibrium

SOFT = StableNeoHookean(mu=1.0, lam=4.0)
MESH = two_bones((6, 3, 3))
AXES = rotation_from_vector(np.array([0.3, -0.2, 0.5])).T.tolist()
FRAME = JointFrame("bone1", "bone2", (30.0, 15.0, 16.0), AXES)
BUSHING = LinearBushing.of_diagonal([30.0, 40.0, 90.0, 900.0, 700.0, 1200.0])
ZONE = NeutralZoneBushing(
    (3.0,) * 3 + (90.0,) * 3, (30.0,) * 3 + (900.0,) * 3, (20.0,) * 3 + (800.0,) * 3, (0.1,) * 3 + (0.05,) * 3,
    (0.4,) * 3 + (0.1,) * 3, (0.0, 0.0, 20.0, 0.0, 0.0, 0.0),
)


def jointed(law, material=SOFT, mesh=MESH) -> ElasticSystem:
    return ElasticSystem(mesh, [material], joints=(Joint(FRAME, law),))


def pulled(mesh=MESH, size: float = 1.0) -> np.ndarray:
    """Forces on the bones' nodes that pull them apart and turn them [N]."""
    load = np.zeros((mesh.n_points, 3))
    load[mesh.part == 1] = [-size, 0.3 * size, 0.0]
    load[mesh.part == 2] = [size, 0.0, 0.5 * size]
    load[(mesh.part == 2) & (mesh.points[:, 1] > 15.0)] += [0.0, 0.0, size]
    return load


@pytest.mark.parametrize("law", [BUSHING, ZONE])
def test_residual_and_tangent_are_derivatives_of_the_energy(law) -> None:
    """On the reduced unknowns, by central differences; bones turned by up to two radians against each other."""
    system = jointed(law)
    rng = np.random.default_rng(0)
    twists = [1, 2, 0, 0.5, -0.3, 0.2, -2, 1, 1, -0.4, 0.9, 1]
    start = np.concatenate([0.3 * rng.normal(size=system.n_dofs - 12), twists])
    state = system.advance(system.rest_state(), start)
    nodal = system.gradient(state)
    residual = system.residual(nodal, state)
    upper = system.tangent(state, nodal_gradient=nodal, project=False).toarray()
    tangent = upper + np.triu(upper, 1).T
    moment = residual[-12:].reshape(2, 6)[:, 3:]
    h = 1e-4
    for _ in range(3):
        way = rng.normal(size=system.n_dofs)
        way[-12:].reshape(2, 6)[:, 3:] *= 0.1
        states = [system.advance(state, step * h * way) for step in (-2, -1, 1, 2)]
        energies = [system.energy(at) for at in states]
        slope = (8.0 * (energies[2] - energies[1]) - (energies[3] - energies[0])) / (12.0 * h)
        assert slope == pytest.approx(float(residual @ way), rel=1e-6)
        residuals = [system.residual(system.gradient(at), at) for at in states]
        change = (8.0 * (residuals[2] - residuals[1]) - (residuals[3] - residuals[0])) / (12.0 * h)
        turns = way[-12:].reshape(2, 6)[:, 3:]
        change[-12:].reshape(2, 6)[:, 3:] += 0.5 * np.cross(moment, turns)  # see ElasticSystem on rotation updates
        np.testing.assert_allclose(change, tangent @ way, rtol=0.0, atol=1e-6 * np.abs(change).max())


def test_no_joint_and_a_joint_without_stiffness_are_the_same_as_before() -> None:
    plain, slack = ElasticSystem(MESH, [SOFT]), jointed(LinearBushing.of_diagonal([0.0] * 6))
    load = pulled()
    found = [equilibrium(system, system.rest_state(), load=load, tolerance=1e-10) for system in (plain, slack)]
    assert found[0].converged
    assert found[1].converged
    np.testing.assert_array_equal(found[0].state.points, found[1].state.points)
    assert plain.energy(found[0].state) == slack.energy(found[0].state)


def test_a_stiff_joint_makes_the_parts_move_as_one() -> None:
    """Against a mesh whose two bones are one rigid part; what is left falls with the stiffness."""
    merged = MESH.part.copy()
    merged[merged == 2] = 1
    one_mesh = type(MESH)(
        MESH.points, MESH.cells, merged, MESH.fixed, ("bone",), MESH.tissue, MESH.tissue_names,
    )
    one = ElasticSystem(one_mesh, [SOFT])
    load = pulled(size=0.5)
    goal = equilibrium(one, one.rest_state(), load=load, tolerance=1e-9).state.points
    gaps = []
    for stiffness in (1e5, 1e6, 1e7):
        system = jointed(LinearBushing.of_diagonal([stiffness] * 3 + [400.0 * stiffness] * 3))
        # a moment is the stiffness times an angle that is known to rounding
        found = equilibrium(system, system.rest_state(), load=load, tolerance=1e-12 * stiffness)
        assert found.converged
        gaps.append(np.abs(found.state.points - goal).max())
    assert gaps[1] / gaps[0] == pytest.approx(0.1, rel=0.05)
    assert gaps[2] / gaps[1] == pytest.approx(0.1, rel=0.05)
    assert gaps[2] <= 1e-4


def test_linear_regime_against_condensation_by_hand() -> None:
    """Small loads: with A the compliance of the bones' twists without joint, (1 + D A Dᵀ K) q = D A f gives q.

    D is written here from the rigid-body field: the joint moves with bone k by t_k + w_k × (o − c_k).
    """
    material, size = LinearElastic(mu=1.0, lam=4.0), 1e-4
    plain, system = ElasticSystem(MESH, [material]), jointed(BUSHING, material)
    load = pulled(size=size)
    solver, rest = SuperLUSolver(), plain.rest_state()
    solver.factorize(plain.tangent(rest))
    columns = np.zeros((plain.n_dofs, 12))
    columns[-12:] = np.eye(12)
    compliance = np.stack([solver.solve(column) for column in columns.T], axis=1)[-12:]
    free = solver.solve(plain.reduce(load, rest))[-12:]
    axes = np.array(AXES)
    field = []
    for k in (1, 2):
        arm = np.array(FRAME.origin) - MESH.points[MESH.part == k].mean(axis=0)
        moved = np.cross(np.eye(3), arm).T  # columns: e_i × arm
        field.append(np.block([[axes, axes @ moved], [np.zeros((3, 3)), axes]]))
    relative = np.concatenate([-field[0], field[1]], axis=1)
    # arms of both bones meet at the joint, so that its frame turning with bone 1 does not shift q to first order
    stiffness = np.array(BUSHING.stiffness)
    q = np.linalg.solve(np.eye(6) + relative @ compliance @ relative.T @ stiffness, relative @ free)
    expected = free - compliance @ relative.T @ stiffness @ q
    state = equilibrium(system, system.rest_state(), load=load, tolerance=1e-13).state
    found = system.difference(system.rest_state(), state)[-12:]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())  # linear to O(size)
    np.testing.assert_allclose(
        system.joints.motions(state.rotation, state.translation)[0], q, rtol=0.0, atol=1e-4 * np.abs(q).max(),
    )


def chain(laws, spacing: float = 30.0):
    """A straight chain of bodies along z, the first one held, joints halfway."""
    n = len(laws)
    names = [f"b{i}" for i in range(n + 1)]
    centroids = np.array([[0.0, 0.0, -spacing * i] for i in range(n + 1)])
    joints = [
        Joint(JointFrame(names[i], names[i + 1], (0.0, 0.0, -spacing * (i + 0.5)), np.eye(3).tolist(), spacing), law)
        for i, law in enumerate(laws)
    ]
    return JointSystem(joints, names, centroids), centroids


def solve_chain(system: JointSystem, n: int, force: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton with force and moment (world axes, constant) at the last body's centroid; the first body is held."""
    rotation, translation = np.tile(np.eye(3), (n + 1, 1, 1)), np.zeros((n + 1, 3))
    for share in np.linspace(0.1, 1.0, 10):
        for _ in range(40):
            residual = system.gradient(rotation, translation)
            residual[n] -= share * np.concatenate([force, moment])
            dense = np.zeros((6 * n + 6, 6 * n + 6))
            system.add_tangent(rotation, translation, dense)
            # Derivative of the residual itself, for Newton under moments that are no potential.
            for k, m in enumerate(system.gradient(rotation, translation)[:, 3:]):
                turn = slice(6 * k + 3, 6 * k + 6)
                dense[turn, turn] -= 0.5 * np.array([[0, -m[2], m[1]], [m[2], 0, -m[0]], [-m[1], m[0], 0]])
            if np.abs(residual[1:]).max() < 1e-9:
                break
            step = np.linalg.solve(dense[6:, 6:], -residual[1:].ravel()).reshape(n, 6)
            translation[1:] += step[:, :3]
            rotation[1:] = rotation_from_vector(step[:, 3:]) @ rotation[1:]
        else:
            raise AssertionError("no convergence")
    return rotation, translation


def closed_chain(laws, spacing: float, force: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planar chain (turns about x, force in the y-z plane) by statics from its tip: the turns are the unknowns.

    Joint i sees the force in the axes of the body below it and the moment m + (tip − second origin) × f, which follow
    from the turns φ of the bodies; the fixed point φ_{i+1} = φ_i + M_i / k_i is iterated to rounding.
    """
    n = len(laws)
    k = [np.diagonal(np.array(law.stiffness)) for law in laws]
    phi = np.zeros(n + 1)
    for _ in range(2000):
        turn = [rotation_from_vector(np.array([angle, 0.0, 0.0])) for angle in phi]
        centre, seconds = np.zeros((n + 1, 3)), np.zeros((n, 3))
        up = np.array([0.0, 0.0, -0.5 * spacing])
        for i in range(n):
            seconds[i] = centre[i] + turn[i] @ (up + (turn[i].T @ force) / k[i][:3])
            centre[i + 1] = seconds[i] + turn[i + 1] @ up
        new = np.zeros(n + 1)
        for i in range(n):
            about = moment + np.cross(centre[n] - seconds[i], force)
            new[i + 1] = new[i] + about[0] / k[i][3]
        if np.abs(new - phi).max() < 1e-16:
            break
        phi = new
    return phi, centre


def test_chain_of_five_under_force_and_moment_in_closed_form() -> None:
    """Planar bending and shear through large turns (some 50°), to 1e-8."""
    laws = [LinearBushing.of_diagonal([50.0 + i, 60.0 - i, 300.0, 2e4, 3e4, 4e4 + 1e3 * i]) for i in range(5)]
    force, moment = np.array([0.0, 6.0, 15.0]), np.array([2500.0, 0.0, 0.0])
    system, centroids = chain(laws)
    rotation, translation = solve_chain(system, 5, force, moment)
    phi, centre = closed_chain(laws, 30.0, force, moment)
    turns = vector_from_rotation(rotation)
    assert abs(phi[-1]) > 0.5
    np.testing.assert_allclose(turns[:, 0], phi, rtol=0.0, atol=1e-8 * np.abs(phi).max())
    np.testing.assert_allclose(turns[:, 1:], 0.0, atol=1e-10)
    np.testing.assert_allclose(
        translation, centre + centroids[0] - centroids, rtol=0.0, atol=1e-8 * np.abs(translation).max(),
    )


def test_chain_under_twist_and_axial_force_in_closed_form() -> None:
    """About and along the chain's own axis the parts do not couple: turns M Σ 1/k, shifts F Σ 1/k, to 1e-8."""
    laws = [LinearBushing.of_diagonal([50.0, 60.0, 300.0 + i, 2e4, 3e4, 4e4 + 1e3 * i]) for i in range(5)]
    system, _ = chain(laws)
    rotation, translation = solve_chain(system, 5, np.array([0.0, 0.0, 40.0]), np.array([0.0, 0.0, 8000.0]))
    turns = vector_from_rotation(rotation)[:, 2]
    np.testing.assert_allclose(turns[1:], np.cumsum([8000.0 / (4e4 + 1e3 * i) for i in range(5)]), rtol=1e-8)
    np.testing.assert_allclose(translation[1:, 2], np.cumsum([40.0 / (300.0 + i) for i in range(5)]), rtol=1e-8)


def test_wrenches_are_equal_and_opposite() -> None:
    """Sum of forces and of moments about the world's origin over the parts, to 1e-10."""
    system, centroids = chain([BUSHING, ZONE, BUSHING])
    rng = np.random.default_rng(1)
    rotation, translation = rotation_from_vector(0.4 * rng.normal(size=(4, 3))), rng.normal(size=(4, 3))
    wrench = system.gradient(rotation, translation)
    moments = wrench[:, 3:] + np.cross(centroids + translation, wrench[:, :3])
    assert np.abs(wrench[:, :3].sum(axis=0)).max() <= 1e-10 * np.abs(wrench[:, :3]).max()
    assert np.abs(moments.sum(axis=0)).max() <= 1e-10 * np.abs(moments).max()


def test_a_scene_refuses_a_joint_of_a_part_that_is_not_there() -> None:
    other = JointFrame("bone1", "sacrum", (0.0, 0.0, 0.0), np.eye(3).tolist())
    with pytest.raises(InputError, match="sacrum"):
        Scene(MESH, spherical_probe(radius=10.0), joints=(Joint(other, BUSHING),))


def test_discs_as_tissue_and_joints_are_refused_together() -> None:
    discs = replace(MESH, tissue_names=("intervertebral_discs",))
    Scene(discs, spherical_probe(radius=10.0))
    with pytest.raises(InputError, match="intervertebral_discs"):
        Scene(discs, spherical_probe(radius=10.0), joints=(Joint(FRAME, BUSHING),))


@dataclass(frozen=True)
class Cubic:
    """A law of a user's own: E = ¼ k |u|⁴."""

    k: float

    def energy(self, motion):
        return 0.25 * self.k * float(motion[:3] @ motion[:3]) ** 2

    def wrench(self, motion):
        return np.concatenate([self.k * (motion[:3] @ motion[:3]) * motion[:3], np.zeros(3)])

    def tangent(self, motion):
        u, matrix = motion[:3], np.zeros((6, 6))
        matrix[:3, :3] = self.k * ((u @ u) * np.eye(3) + 2.0 * np.outer(u, u))
        return matrix


def test_a_law_of_ones_own_is_solved_like_any_other() -> None:
    system = jointed(Cubic(5.0))
    found = equilibrium(system, system.rest_state(), load=pulled(), tolerance=1e-9)
    assert found.converged
    free = equilibrium(ElasticSystem(MESH, [SOFT]), system.rest_state(), load=pulled(), tolerance=1e-9)
    apart = [np.linalg.norm(system.joints.motions(s.state.rotation, s.state.translation)[0, :3]) for s in (found, free)]
    assert apart[0] < apart[1]


def test_projection_lifts_only_negative_eigenvalues() -> None:
    """Far from rest the Hessian of a joint is indefinite; projected it is not, and at rest nothing changes."""
    system, _ = chain([BUSHING])
    for size in (0.0, 1.5):
        rotation = rotation_from_vector(size * np.array([[0.3, 0.0, 0.2], [-0.5, 0.4, 0.0]]))
        translation = size * np.array([[0.0, 0.0, 0.0], [4.0, -5.0, 9.0]])
        exact, projected = np.zeros((12, 12)), np.zeros((12, 12))
        system.add_tangent(rotation, translation, exact)
        system.add_tangent(rotation, translation, projected, project=True)
        scale = np.abs(exact).max()
        low = np.linalg.eigvalsh(exact).min()
        assert (low < -1e-3 * scale) == (size > 0.0)
        assert np.linalg.eigvalsh(projected).min() >= -1e-12 * scale
        if size == 0.0:
            np.testing.assert_allclose(projected, exact, rtol=0.0, atol=1e-12 * scale)
