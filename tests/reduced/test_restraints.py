"""Joints, foundations and held parts on the reduced side, against the finite-element solver."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.fem import (
    ElasticSystem,
    Joint,
    JointFrame,
    LinearBushing,
    NeutralZoneBushing,
    SolverConfig,
    SuperLUSolver,
    solve_imposed,
)
from mixpinn.physics.foundation import Face, Foundation
from mixpinn.physics.membrane import Membrane
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.newton_steps import NewtonSteps
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving.hybrid_predictor import HybridPredictor
from reduced.pressed_block import TISSUE, pressed_table, top_nodes
from training.toy_block import block_mesh

AXES = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
FRAME = JointFrame("L1", "L2", (15.0, 21.0, 25.0), AXES)
JOINT = Joint(FRAME, LinearBushing.of_diagonal([3.0, 4.0, 9.0, 900.0, 700.0, 1200.0]))
PAD = Foundation(Face.FRONT, 2e-3, shear=1e-3, sink=2.0)
SLIDE = Foundation(Face.CAPS, 1.0)
SKIN = Membrane(shear=0.05, tension=0.01)


def held(mesh: TissueMesh, k: int) -> TissueMesh:
    return replace(mesh, fixed=mesh.fixed | (mesh.part == k))


def free(mesh: TissueMesh) -> TissueMesh:
    return replace(mesh, fixed=np.zeros(mesh.n_points, dtype=bool))


BODIES = {
    "joint": (block_mesh(), Restraints((JOINT,))),
    "joint to a held part": (held(block_mesh(), 2), Restraints((JOINT,))),
    "pad": (free(block_mesh()), Restraints((), (PAD,))),
    "joint, pad, sliding caps": (free(block_mesh()), Restraints((JOINT,), (PAD, SLIDE))),
    "skin": (block_mesh(), Restraints(membrane=SKIN)),
    "joint, skin, quadratic": (block_mesh().with_order(2), Restraints((JOINT,), membrane=SKIN)),
    "held, quadratic": (held(free(block_mesh()), 2).with_order(2), Restraints((JOINT,), (PAD,))),
}


@pytest.fixture(params=BODIES, scope="module")
def body(request) -> tuple[TissueMesh, Restraints]:
    return BODIES[request.param]


def prior_of(mesh: TissueMesh, restraints: Restraints) -> ElasticPrior:
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver(), restraints=restraints)


def test_residual_is_that_of_the_solver(body) -> None:
    mesh, tied = body
    coordinates, rng = ReducedCoordinates(mesh), np.random.default_rng(3)
    unknowns = 0.5 * rng.standard_normal(coordinates.size)
    unknowns[coordinates.n_soft:] *= 0.3
    unknowns[coordinates.n_soft:].reshape(-1, 6)[coordinates.held] = 0.0
    system = ElasticSystem(mesh, [TISSUE], joints=tied.joints, foundations=tied.foundations, membrane=tied.membrane)
    state = system.advance(system.rest_state(), unknowns)
    expected = system.residual(system.gradient(state), state)
    found = Equilibrium.of_materials(mesh, [TISSUE], tied).residual(unknowns, coordinates)
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())
    assert not expected[system.locked].any()
    assert system.locked.sum() == 6 * mesh.held_parts.sum()


def test_small_loads_are_answered_as_the_solver_does(body) -> None:
    """Half the difference of the answers to ±1e-3 mm, which is linear to 1e-8."""
    mesh, tied = body
    prior, top = prior_of(mesh, tied), top_nodes(mesh)[::3]
    away = np.linalg.norm(mesh.node_points[top][:, [0, 2]] - [18.0, 23.0], axis=1)
    move = 1e-3 * np.exp(-((away / 15.0) ** 2))[:, None] * [0.3, -1.0, 0.2]
    system = ElasticSystem(mesh, [TISSUE], joints=tied.joints, foundations=tied.foundations, membrane=tied.membrane)
    config = SolverConfig(tolerance=1e-8, force_floor=1e-12)
    exact = [solve_imposed(system, [(top, way * move)], config=config, linear=SuperLUSolver()) for way in (1.0, -1.0)]
    assert exact[0].converged.all()
    assert exact[1].converged.all()
    expected = 0.5 * (exact[0].displacement[0] - exact[1].displacement[0])
    field = 0.5 * (prior.predict(top, move) - prior.predict(top, -move))
    np.testing.assert_allclose(field, expected, rtol=0.0, atol=1e-6 * np.abs(move).max())


def test_newton_steps_end_at_the_solution(body) -> None:
    mesh, tied = body
    prior = prior_of(mesh, tied)
    sample = pressed_table(mesh, 1, seed=9, restraints=tied)[0]
    contact = prior.hold(sample.contact_nodes)
    start = prior.respond_to_forces(contact, contact.solve(sample.contact_displacement.ravel()))
    field, history = NewtonSteps(prior, [TISSUE]).refine(start, contact, 6)
    assert history[-1] < 1e-9
    np.testing.assert_allclose(field, sample.displacement, atol=1e-5)


def test_the_hybrid_model_learns_and_keeps_joints(tmp_path) -> None:
    mesh, tied = BODIES["joint, pad, sliding caps"]
    table = pressed_table(mesh, 24, seed=2, restraints=tied)
    train, test = table.at_positions(range(18)), table.at_positions(range(18, 24))
    prior = prior_of(mesh, tied)
    model = fit_hybrid(prior, [TISSUE], train, test, HybridConfig(modes=12, coordinates=3))

    def missed(candidate) -> float:
        return float(np.mean([
            np.linalg.norm(candidate.predict(*test.contact(i)) - test.displacement[i], axis=1).mean()
            for i in range(len(test))
        ]))

    assert missed(model) < 0.5 * missed(prior)
    # a prior that knows no joints is far from these fields: what is tested is seen at all
    floating = ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver(),
                                  restraints=Restraints((), tied.foundations))
    assert missed(floating) > 1.5 * missed(prior)

    mesh.save(tmp_path / "mesh.vtu")
    model.save(tmp_path)
    again = HybridModel.load(tmp_path, mesh)
    assert again.prior.restraints == tied
    np.testing.assert_allclose(again.predict(*test.contact(0)), model.predict(*test.contact(0)), atol=1e-6)
    predictor = HybridPredictor(again)
    answer, residuals = predictor.refine(*test.contact(0), 6)
    assert residuals[-1] < 1e-9
    np.testing.assert_allclose(answer.displacement, test.displacement[0], atol=1e-5)


def test_a_neutral_zone_is_read_back(tmp_path) -> None:
    mesh = block_mesh()
    zone = NeutralZoneBushing((1.0,) * 6, (5.0,) * 6, (4.0,) * 6, (0.2,) * 6, (0.1,) * 6)
    prior_of(mesh, Restraints((Joint(FRAME, zone),))).save(tmp_path)
    assert ElasticPrior.load(tmp_path, mesh).restraints.joints[0].law == zone


def test_a_law_of_ones_own_cannot_be_kept(tmp_path) -> None:
    class Mine(LinearBushing):
        """Another class."""

    mesh = block_mesh()
    prior = prior_of(mesh, Restraints((Joint(FRAME, Mine(JOINT.law.stiffness)),)))
    with pytest.raises(InputError, match="Mine"):
        prior.save(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_prior_without_restraints_is_as_it_was(tmp_path) -> None:
    prior = prior_of(block_mesh(), FREE)
    prior.save(tmp_path)
    assert ElasticPrior.load(tmp_path, block_mesh()).restraints == FREE
