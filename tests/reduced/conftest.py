"""A block pressed from above and its elastic prior, of linear and of quadratic cells."""

import pytest

from mixpinn.fem import SuperLUSolver
from mixpinn.reduced.build_prior import build_prior
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh


@pytest.fixture(scope="module", params=[1, 2])
def mesh(request):
    return block_mesh().with_order(request.param)


@pytest.fixture(scope="module")
def prior(mesh):
    return build_prior(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
