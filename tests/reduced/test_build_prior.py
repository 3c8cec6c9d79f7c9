"""Building the prior: rows of the inverse stiffness, whatever the chunks; what it refuses."""

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.fem import ElasticSystem, SuperLUSolver
from mixpinn.reduced.build_prior import build_prior
from mixpinn.reduced.compliance.clusters import ClusteredCompliance
from mixpinn.reduced.compliance.forms import DenseCompliance
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh


def test_compliance_is_the_inverse_of_the_stiffness_at_the_contact_nodes():
    mesh = block_mesh()
    nodes = top_nodes(mesh)[::3]
    system = ElasticSystem(mesh, [TISSUE])
    upper = system.tangent(system.rest_state(), project=False).toarray()
    inverse = np.linalg.inv(upper + np.triu(upper, 1).T)[system.node_dofs(nodes).ravel()]
    for chunk in (1, 5, 96):
        prior = build_prior(mesh, [TISSUE], nodes=nodes[::-1], linear=SuperLUSolver(), chunk=chunk)
        assert isinstance(prior.compliance, DenseCompliance)
        np.testing.assert_array_equal(prior.nodes, nodes)
        np.testing.assert_allclose(prior.compliance.matrix, inverse, atol=1e-6 * np.abs(inverse).max())


def test_what_is_too_large_is_made_in_clusters_as_those_of_the_whole():
    """Whatever the chunks of right-hand sides; answers are the whole ones' to rounding."""
    mesh = block_mesh().with_order(2)
    nodes = top_nodes(mesh)
    whole = build_prior(mesh, [TISSUE], nodes=nodes, linear=SuperLUSolver())
    size = np.abs(whole.compliance.matrix).max()
    for chunk in (7, 96):
        parts = build_prior(mesh, [TISSUE], nodes=nodes, linear=SuperLUSolver(), chunk=chunk, dense_bytes=0)
        assert isinstance(parts.compliance, ClusteredCompliance)
        assert len(parts.compliance.clusters) > 1
        np.testing.assert_allclose(parts.own_compliance, whole.own_compliance, atol=1e-6 * size)
        np.testing.assert_allclose(parts.compliance.dense(), whole.compliance.matrix, atol=3e-4 * size)


def test_nodes_that_no_probe_moves_are_refused():
    mesh = block_mesh()
    for nodes in (np.flatnonzero(mesh.fixed)[:2], np.flatnonzero(mesh.part == 1)[:2], np.empty(0, np.int64)):
        with pytest.raises(InputError, match="free soft nodes"):
            build_prior(mesh, [TISSUE], nodes=nodes, linear=SuperLUSolver())
