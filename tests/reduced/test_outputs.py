import pytest

from mixpinn.base.errors import InputError
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.outputs import Outputs
from reduced.part_of_whole import outputs_are_part_of_the_whole
from reduced.pressed_block import TISSUE, pressed_table


@pytest.fixture(scope="module")
def table(mesh):
    return pressed_table(mesh, 8)


@pytest.fixture(scope="module")
def model(prior, table):
    config = HybridConfig(modes=20, coordinates=4, drawn_contacts=8)
    return fit_hybrid(prior, [TISSUE], table.at_positions(range(6)), table.at_positions(range(6, 8)), config)


def test_what_is_asked_for_is_that_part_of_the_whole(model, table) -> None:
    outputs_are_part_of_the_whole(model, table, within=1e-6)


def test_a_node_that_is_not_there_is_refused(model, mesh) -> None:
    for wrong in ([mesh.n_nodes], [-1, 0]):
        with pytest.raises(InputError, match="nodes of the mesh"):
            Outputs(model, wrong)
