"""Where a Newton step of the whole body leads the skin under forces: from all cells, and from those near them."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.fem import SuperLUSolver
from mixpinn.press.newton_shift import newton_shift
from mixpinn.reduced.build_prior import build_prior
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.near_cells import NearCells
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh


@pytest.fixture(scope="module")
def hybrid():
    mesh = block_mesh().with_order(2)
    prior = build_prior(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    return HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, [TISSUE]))


def pressed(hybrid):
    """Nodes around the middle of the top, and forces that press them in by 2 mm."""
    places = hybrid.mesh.node_points[hybrid.prior.nodes]
    nodes = hybrid.prior.nodes[np.linalg.norm(places[:, [0, 2]] - [18.0, 22.0], axis=1) < 12.0]
    return nodes, hybrid.prior.respond(nodes, np.tile([0.0, -2.0, 0.0], (len(nodes), 1)))[1]


def test_it_is_the_answer_to_what_the_linear_answer_leaves_unbalanced(hybrid) -> None:
    nodes, forces = pressed(hybrid)
    shift, here = newton_shift(hybrid, nodes, forces)
    np.testing.assert_allclose(here, np.tile([0.0, -2.0, 0.0], (len(nodes), 1)), atol=1e-5)
    small, _ = newton_shift(hybrid, nodes, 0.1 * forces)
    assert np.linalg.norm(small) == pytest.approx(0.01 * np.linalg.norm(shift), rel=0.3)  # of second order


def test_from_cells_near_the_forces_it_is_nearly_the_same(hybrid) -> None:
    nodes, forces = pressed(hybrid)
    expected = newton_shift(hybrid, nodes, forces)[0]
    for reach, most in ((1e4, 0.03), (40.0, 0.15)):
        near = NearCells(hybrid.mesh, hybrid.newton.equilibrium, hybrid.prior.nodes, reach)
        found = newton_shift(replace(hybrid, newton=replace(hybrid.newton, near=near)), nodes, forces)[0]
        assert np.linalg.norm(found - expected) < most * np.linalg.norm(expected)
