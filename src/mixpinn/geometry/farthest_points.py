"""Farthest points first: an order in which every beginning covers a set evenly."""

from collections.abc import Callable

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray


def farthest_first(distance: Callable[[int], FloatArray], *, first: int, count: int) -> IntArray:
    """Indices in an order in which each is the farthest from all before it; ties go to the lowest index.

    T. F. Gonzalez (Theoretical Computer Science 38, 1985): every beginning leaves gaps at most twice as wide as the
    best choice of as many.

    Args:
        distance: from the entry of an index to all N entries, or anything that grows with it, shape (N,).
        first: the index to begin with.
        count: how many, at most N.

    Returns:
        Shape (count,).
    """
    order = [first]
    nearest = np.array(distance(first), dtype=np.float64)
    nearest[first] = -1.0
    while len(order) < min(count, len(nearest)):
        following = int(nearest.argmax())
        order.append(following)
        nearest = np.minimum(nearest, distance(following))
        nearest[order] = -1.0
    return np.array(order[:count], dtype=np.int64)


def distances_between(points: FloatArray) -> Callable[[int], FloatArray]:
    """Euclidean distances [mm] between points [mm], shape (N, 3), as `farthest_first` asks for them."""

    def distance(index: int) -> FloatArray:
        apart: FloatArray = np.linalg.norm(points - points[index], axis=1)
        return apart

    return distance
