import numpy as np
import pytest

from fem.block_mesh import labelled, two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem.elements.input_check import check_elastic_input


def test_bad_meshes_are_refused():
    mesh = two_bones((3, 2, 2))
    bone = mesh.part == 1
    wider = mesh.part.copy()  # a part of two nodes, of which one is fixed
    wider[mesh.cells[(mesh.part[mesh.cells] == 1).any(axis=1)][0][:2]] = 1
    cases = {
        "cells of positive volume": labelled(mesh.points, mesh.cells[:, [1, 0, 2, 3]], part=mesh.part),
        "no fixed node": labelled(mesh.points, mesh.cells, part=np.where(bone, 1, wider), fixed=bone),
        "each soft node in a cell": labelled(np.vstack([mesh.points, [[99.0, 0, 0]]]), mesh.cells),
        "nodes in each rigid part": labelled(mesh.points, mesh.cells, part=np.where(bone, 2, 0)),
        "finite points": labelled(np.where(bone[:, None], np.nan, mesh.points), mesh.cells),
    }
    for message, bad in cases.items():
        with pytest.raises(InputError, match=message):
            check_elastic_input(bad, 1, None)
    with pytest.raises(InputError, match="one for each tissue"):
        check_elastic_input(mesh, 2, None)
    with pytest.raises(InputError, match="pairs of nodes"):
        check_elastic_input(mesh, 1, np.array([[0, 10**6]]))


def test_a_good_mesh_passes():
    mesh = two_bones((3, 2, 2))
    assert check_elastic_input(mesh, 1, mesh.edges) is None
