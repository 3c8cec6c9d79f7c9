"""Outputs of some nodes against the same nodes of the whole field."""

import numpy as np

from mixpinn.reduced.outputs import Outputs


def outputs_are_part_of_the_whole(model, table, *, within: float) -> None:
    """For vertices, rigid, fixed and contact nodes, one twice and none; `within` of the largest displacement."""
    rng, mesh, last = np.random.default_rng(0), model.mesh, len(table) - 1
    part = np.flatnonzero(mesh.node_part > 0)
    for chosen in (
        np.arange(mesh.n_points), rng.permutation(mesh.n_nodes)[:40], part[::-3], table.contact(last)[0],
        np.flatnonzero(mesh.node_fixed)[:3], np.array([5, 5, 2]), np.empty(0, dtype=np.int64),
    ):
        outputs = Outputs(model, chosen)
        for index in (0, last):
            whole, found = model.predict(*table.contact(index)), outputs.predict(*table.contact(index))
            assert found.shape == (len(chosen), 3)
            assert np.abs(found - whole[chosen]).max(initial=0.0) <= within * np.abs(whole).max()
