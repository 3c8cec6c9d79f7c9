"""Quadrature rules of the tetrahedron and the triangle, in barycentric coordinates.

Rules of the tetrahedron with p points that are exact for polynomials of degree d:

- 4 points, d = 2: α = (5 + 3√5)/20 at a vertex, β = (5 − √5)/20 at the others;
- 5 points, d = 3, and 11 points, d = 4 (P. Keast, Moderate-degree tetrahedral quadrature formulas, Computer Methods in
  Applied Mechanics and Engineering 55, 1986): their weight at the centroid is negative, so that the integral of a
  non-negative energy may be negative;
- 8 points, d = 3: vertices and centroids of the faces;
- 14 points, d = 5, all weights positive, in the closed form of M. Gellert and R. Harbord, Moderate degree cubature
  formulas for 3-D tetrahedral finite-element approximations, Communications in Applied Numerical Methods 7, 1991.

The constants were taken from open codes that name these sources; the tests integrate every monomial with them.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mixpinn.base.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Points and weights on a simplex.

    Attributes:
        name: of the rule.
        degree: of the polynomials that are integrated exactly.
        points: barycentric coordinates, shape (p, 4) on a tetrahedron, (p, 3) on a triangle.
        weights: they sum to one, shape (p,).
    """

    name: str
    degree: int
    points: FloatArray
    weights: FloatArray

    def __len__(self) -> int:
        return len(self.weights)

    def __repr__(self) -> str:
        return self.name


def _corners(at: float, corners: int = 4) -> FloatArray:
    """Points with the coordinate `at` at one vertex and equal ones at the others."""
    other = (1.0 - at) / (corners - 1)
    return np.full((corners, corners), other) + (at - other) * np.eye(corners)


def _edges(at: float) -> FloatArray:
    """The six points with the coordinate `at` at two vertices of a tetrahedron and equal ones at the other two."""
    points = np.full((6, 4), 0.5 - at)
    for row, pair in enumerate(combinations(range(4), 2)):
        points[row, pair] = at
    return points


def _rule(name: str, degree: int, *orbits: tuple[FloatArray, float]) -> Quadrature:
    return Quadrature(
        name, degree, np.concatenate([points for points, _ in orbits]),
        np.concatenate([np.full(len(points), weight) for points, weight in orbits]),
    )


def _fourteen() -> Quadrature:
    root = math.sqrt(46.0)
    turn = math.acos(1.0 / (46.0 * root)) + 2.0 / 3.0 * math.asin(1.0 / (46.0 * root))
    k = (104.0 + 8.0 * root * math.cos(turn)) / 3.0
    s = math.sqrt(49.0 - k)
    b, d = (7.0 + s) / k, (7.0 - s) / k
    a, c = 1.0 - 3.0 * b, 1.0 - 3.0 * d
    p = (98.0 - k - 14.0 * s) / (1680.0 * s * (b - a) ** 3)
    q = (98.0 - k + 14.0 * s) / (1680.0 * s * (c - d) ** 3)
    r = (1.0 - 4.0 * (p + q)) / 6.0
    return _rule(
        "14 points", 5, (_corners(a), p), (_corners(c), q), (_edges((1.0 + (2.0 / (105.0 * r)) ** 0.25) / 4.0), r),
    )


_CENTRE = np.full((1, 4), 0.25)

TETRAHEDRON_4 = _rule("4 points", 2, (_corners((5.0 + 3.0 * math.sqrt(5.0)) / 20.0), 0.25))
TETRAHEDRON_5 = _rule("5 points", 3, (_CENTRE, -0.8), (_corners(0.5), 0.45))
TETRAHEDRON_8 = _rule("8 points", 3, (_corners(1.0), 1.0 / 40.0), (_corners(0.0), 9.0 / 40.0))
TETRAHEDRON_11 = _rule(
    "11 points", 4, (_CENTRE, -148.0 / 1875.0), (_corners(11.0 / 14.0), 343.0 / 7500.0),
    (_edges((1.0 + math.sqrt(5.0 / 14.0)) / 4.0), 56.0 / 375.0),
)
TETRAHEDRON_14 = _fourteen()
TETRAHEDRON_RULES = (TETRAHEDRON_4, TETRAHEDRON_5, TETRAHEDRON_8, TETRAHEDRON_11, TETRAHEDRON_14)

TRIANGLE_3 = _rule("3 points", 2, (_corners(2.0 / 3.0, 3), 1.0 / 3.0))
"""Degree 2 with inner points: exact for the loads of six-node faces under uniform pressure."""
