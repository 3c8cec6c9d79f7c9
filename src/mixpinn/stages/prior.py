"""The elastic prior of a mesh, computed once and kept in the cache."""

import contextlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import AnyArray, IntArray
from mixpinn.base.cache import optional_cache
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.lock import locked
from mixpinn.fem import Material
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.records.plain import plain
from mixpinn.reduced.prior import ElasticPrior, probed_nodes


def body_folder(
    what: str, mesh: TissueMesh, materials: Sequence[Material], restraints: Restraints, nodes: IntArray,
    *settings: float,
) -> Path | None:
    """Where the cache keeps what is made of a body at rest and some of its nodes; None where it keeps nothing of it.

    Args:
        what: is made.
        mesh, materials, restraints: the body.
        nodes: of the mesh, shape (c,).
        settings: what else it depends on.
    """
    # A class of the user's own that is no dataclass has no constants that could be recorded: not kept.
    laws = [*materials, *(joint.law for joint in restraints.joints)]
    if not all(isinstance(plain(law), dict) for law in laws):
        return None
    tied = [restraints.record()] if restraints != FREE else []
    body = (mesh.hash(), plain(list(materials)), *tied, *settings)
    return optional_cache(what, hash_arrays(nodes, np.frombuffer(repr(body).encode(), dtype=np.uint8)))


def cached_prior(
    mesh: TissueMesh, materials: Sequence[Material], *, touched: AnyArray | Sequence[int] = (),
    restraints: Restraints = FREE,
) -> ElasticPrior:
    """The elastic prior for every node that a probe may touch; computed once, then read from the cache.

    Args:
        mesh: the mesh.
        materials: one for each of its tissues.
        touched: further nodes that samples touch, shape (c,).
        restraints: joints and foundations of the body.
    """
    nodes = np.union1d(probed_nodes(mesh), np.asarray(touched, dtype=np.int64))
    folder = body_folder("prior", mesh, materials, restraints, nodes)
    if folder is None:
        return ElasticPrior.build(mesh, materials, nodes=nodes, restraints=restraints)
    if (known := _kept(folder, mesh)) is not None:
        return known
    with locked(folder, wait=True):  # two processes that need the same prior compute it once
        if (known := _kept(folder, mesh)) is not None:
            return known
        prior = ElasticPrior.build(mesh, materials, nodes=nodes, restraints=restraints)
        prior.save(folder)
        return prior


def _kept(folder: Path, mesh: TissueMesh) -> ElasticPrior | None:
    """The prior in a folder of the cache; None where it is absent, damaged, or inexact, as of earlier versions."""
    with contextlib.suppress(InputError):
        prior = ElasticPrior.load(folder, mesh)
        return prior if prior.missed == 0.0 else None
    return None
