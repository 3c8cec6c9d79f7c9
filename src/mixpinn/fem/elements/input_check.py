"""What a mesh must satisfy before elastic energies are computed on it."""

import numpy as np

from mixpinn.base.arrays import IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh


def _fail(what: str, expected: str, got: str, fix: str) -> None:
    raise InputError(what, expected=expected, got=got, fix=fix)


def check_elastic_input(mesh: TissueMesh, tissues: int, extra_pairs: IntArray | None) -> None:
    """Refuse what `ElasticSystem` cannot compute with.

    Args:
        mesh: the mesh.
        tissues: number of materials given.
        extra_pairs: pairs of nodes, shape (p, 2), or None.

    Raises:
        InputError: see `ElasticSystem`.
    """
    parts = np.bincount(np.maximum(mesh.part, 0), minlength=mesh.n_parts + 1)[1:]
    if tissues != len(mesh.tissue_names):
        _fail("materials", f"one for each tissue ({', '.join(mesh.tissue_names)})", str(tissues), "give one for each")
    if not np.isin(mesh.tissue, np.arange(tissues)).all():
        _fail("mesh", f"tissue labels 0 … {tissues - 1}", str(np.unique(mesh.tissue)), "label the cells again")
    if not np.isfinite(mesh.points).all():
        _fail("mesh", "finite points", "not a number or infinity", "mesh again")
    bad = np.flatnonzero(~(mesh.cell_volumes > 0.0))
    if len(bad):
        _fail("mesh", "cells of positive volume", f"{len(bad)} others, the first is cell {bad[0]}", "mesh again")
    if len(parts) > mesh.n_parts or not parts.all() or mesh.part.min() < 0:
        _fail("mesh", f"nodes in each rigid part 1 … {mesh.n_parts}", f"node counts {parts}", "label the nodes again")
    for k in np.unique(mesh.part[mesh.fixed & (mesh.part > 0)]):
        if not mesh.held_parts[k - 1]:
            _fail(f"rigid part {mesh.rigid_names[k - 1]}", "no fixed node, or all", "some", "fix all of it, or none")
    lonely = (mesh.part == 0) & ~mesh.fixed
    lonely[mesh.cells] = False
    if lonely.any():
        _fail("mesh", "each soft node in a cell", f"{np.count_nonzero(lonely)} without", "remove the unused nodes")
    if extra_pairs is not None and (extra_pairs.ndim != 2 or not np.isin(extra_pairs, np.arange(mesh.n_nodes)).all()):
        _fail("extra_pairs", f"pairs of nodes 0 … {mesh.n_nodes - 1}", "others", "correct the pairs")
