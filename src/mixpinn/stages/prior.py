"""The elastic prior of a mesh, computed once and kept in the cache."""

import contextlib
from collections.abc import Sequence

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.cache import cache_folder
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.lock import locked
from mixpinn.fem import Material
from mixpinn.fem.scene_record import plain
from mixpinn.records import TissueMesh
from mixpinn.reduced.prior import ElasticPrior, probed_nodes


def cached_prior(
    mesh: TissueMesh, materials: Sequence[Material], *, touched: AnyArray | Sequence[int] = (),
) -> ElasticPrior:
    """The elastic prior for every node that a probe may touch; computed once, then read from the cache.

    Args:
        mesh: the mesh.
        materials: one for each of its tissues.
        touched: further nodes that samples touch, shape (c,).
    """
    nodes = np.union1d(probed_nodes(mesh), np.asarray(touched, dtype=np.int64))
    # A class of the user's own that is no dataclass has no constants that could be recorded: not kept.
    kept = all(isinstance(plain(material), dict) for material in materials)
    if not kept:
        return ElasticPrior.build(mesh, materials, nodes=nodes)
    key = hash_arrays(nodes, np.frombuffer(repr((mesh.hash(), plain(list(materials)))).encode(), dtype=np.uint8))
    folder = cache_folder("prior", key)
    with locked(folder, wait=True):  # two processes that need the same prior compute it once
        with contextlib.suppress(InputError):  # what is absent or damaged in the cache is made anew
            return ElasticPrior.load(folder, mesh)
        prior = ElasticPrior.build(mesh, materials, nodes=nodes)
        prior.save(folder)
        return prior
