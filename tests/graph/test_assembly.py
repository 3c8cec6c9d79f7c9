"""Network inputs and targets from fields on the mesh."""

import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.graph import build_graph, node_input, virtual_targets
from mixpinn.records import TissueMesh


def test_contact_displacement_comes_first(two_cells: TissueMesh) -> None:
    graph = build_graph(two_cells)
    field = torch.randn(3, 5, 3)
    x = node_input(graph, field)
    assert torch.equal(x[..., :3], field)
    assert torch.equal(x[1, :, 3:], graph.node_features)
    assert torch.equal(virtual_targets(graph, field), field)


@pytest.mark.parametrize("shape", [(5, 3), (1, 4, 3), (1, 5, 2)])
def test_a_field_of_another_mesh_is_refused(two_cells: TissueMesh, shape: tuple[int, ...]) -> None:
    graph = build_graph(two_cells)
    with pytest.raises(InputError, match=r"\(B, 5, 3\)"):
        node_input(graph, torch.zeros(shape))
    with pytest.raises(InputError, match=r"\(B, 5, 3\)"):
        virtual_targets(graph, torch.zeros(shape))
