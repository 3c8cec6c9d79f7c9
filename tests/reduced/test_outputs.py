import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.outputs import Outputs
from reduced.pressed_block import TISSUE, pressed_table


@pytest.fixture(scope="module")
def table(mesh):
    return pressed_table(mesh, 8)


@pytest.fixture(scope="module")
def model(prior, table):
    config = HybridConfig(modes=20, coordinates=4, drawn_contacts=8)
    return fit_hybrid(prior, [TISSUE], table.at_positions(range(6)), table.at_positions(range(6, 8)), config)


def test_what_is_asked_for_is_that_part_of_the_whole(model, table, mesh) -> None:
    rng = np.random.default_rng(0)
    part = np.flatnonzero(mesh.node_part > 0)
    for chosen in (
        np.arange(mesh.n_points), rng.permutation(mesh.n_nodes)[:40], part[::-3], table.contact(7)[0],
        np.flatnonzero(mesh.node_fixed)[:3], np.array([5, 5, 2]), np.empty(0, dtype=np.int64),
    ):
        outputs = Outputs(model, chosen)
        for index in (0, len(table) - 1):
            whole, found = model.predict(*table.contact(index)), outputs.predict(*table.contact(index))
            assert found.shape == (len(chosen), 3)
            assert np.abs(found - whole[chosen]).max(initial=0.0) <= 1e-6 * np.abs(whole).max()


def test_a_node_that_is_not_there_is_refused(model, mesh) -> None:
    for wrong in ([mesh.n_nodes], [-1, 0]):
        with pytest.raises(InputError, match="nodes of the mesh"):
            Outputs(model, wrong)
