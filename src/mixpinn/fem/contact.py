"""Frictional contact of the rigid probe with the skin.

Method: a stiff, twice differentiable penalty on every locally nearest pair of (probe sample, skin triangle) and of
(skin vertex, probe triangle), with Coulomb friction by return mapping of an elastic slip. It was chosen over

* a logarithmic barrier, which needs a line search that never lets a pair cross and therefore many short steps where
  the probe itself moves by half the gap between two solves; and
* an augmented Lagrangian or an active set, which satisfy the gap exactly at the price of a second loop of solves,

because with a 2 mm gap the probe stays on its own side of the skin even where the penalty gives way by hundredths of
a millimetre, each pair couples only nodes of one triangle (the sparsity of the stiffness never changes, so that its
symbolic factorization is kept), and one loop of Newton iterations does everything. The violation of the gap is
reported with every step.

Normal contact. For a pair at distance d the violation is v = g − d with the gap g, the energy

    φ(v) = 0                              v ≤ 0
         = k v³ / (6 δ)                   0 < v < δ
         = k (v²/2 − δ v/2 + δ²/6)        v ≥ δ

and the force N = φ'(v) acts along the line that joins the pair.

Friction. For each contact point the relative tangential motion Δs since the start of the step is measured between
two material points chosen at the start of the step. The elastic slip e = e₀ + Δs carries T = k_t e while
k_t |e| ≤ μ N (stick), otherwise T = μ N e/|e| (slip), and at the end of the step e₀ ← T / k_t (J. C. Simo and
T. A. Laursen, An augmented Lagrangian treatment of contact problems involving friction, Computers & Structures 42,
1992: its penalty regularization). N is that of the current iterate.
"""

from dataclasses import dataclass, field

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.fem.contact_geometry import Proximity, proximity
from mixpinn.fem.contact_surface import ProbeSurface, SkinSurface


@dataclass(frozen=True)
class ContactConfig:
    """How the probe touches the skin.

    Attributes:
        gap: distance at which contact acts [mm].
        alarm: distance within which nodes are listed as near [mm].
        friction: Coulomb's coefficient μ.
        stiffness: k of one contact point [N/mm].
        smoothing: δ, the violation over which the contact stiffness sets in [mm].
        spacing: largest distance between neighbouring contact points on the probe [mm].
    """

    gap: float = 2.0
    alarm: float = 4.0
    friction: float = 1.0
    stiffness: float = 100.0
    smoothing: float = 0.02
    spacing: float = 2.0


@dataclass(frozen=True, eq=False)
class ProbePose:
    """Rigid placement of the probe: rotation (3, 3) and tip position [mm] (3,)."""

    rotation: FloatArray
    translation: FloatArray

    def place(self, points: FloatArray) -> FloatArray:
        """World positions of points of the probe's frame, shape (p, 3) [mm]."""
        return points @ self.rotation.T + self.translation

    def towards(self, other: "ProbePose", fraction: float) -> "ProbePose":
        """The pose at `fraction` of the screw-free motion to `other`."""
        turn = Rotation.from_matrix(other.rotation @ self.rotation.T).as_rotvec()
        return ProbePose(
            Rotation.from_rotvec(fraction * turn).as_matrix() @ self.rotation,
            (1.0 - fraction) * self.translation + fraction * other.translation,
        )


@dataclass(frozen=True, eq=False)
class FrictionFrame:
    """What friction refers to during one step; one entry for each contact point (probe sample or skin vertex).

    Attributes:
        anchored: contact points that were near at the start of the step, shape (p,).
        vertices: skin vertices of the material point, shape (p, 3).
        weights: their weights, shape (p, 3).
        local: material point of the probe in its own frame [mm], shape (p, 3).
        normal: unit normal at the start of the step, from probe to skin, shape (p, 3).
        start: relative position skin − probe at the start of the step [mm], shape (p, 3).
        slip: elastic slip carried into the step [mm], shape (p, 3).
    """

    anchored: BoolArray
    vertices: IntArray
    weights: FloatArray
    local: FloatArray
    normal: FloatArray
    start: FloatArray
    slip: FloatArray


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Contact evaluated at one configuration.

    Attributes:
        energy: of contact and of friction at the current normal forces [N mm].
        gradient: derivative of the energy by skin vertex positions [N], shape (v, 3); forces are its negative.
        first, second, blocks: contributions to the stiffness [N/mm]: vertex pairs (b,), (b,) and blocks (b, 3, 3),
            every pair listed once.
        slip: elastic slip of each contact point if the step ended here [mm], shape (p, 3).
        normal_force: of each contact point [N], shape (p,).
        penetration: largest violation of the gap [mm].
        hits: number of active pairs.
    """

    energy: float
    gradient: FloatArray
    first: IntArray
    second: IntArray
    blocks: FloatArray
    slip: FloatArray
    normal_force: FloatArray
    penetration: float
    hits: int


@numba.njit(cache=True)
def _penalty(v, k, delta):  # type: ignore[no-untyped-def]
    """φ, φ' and φ'' of the module's text."""
    if v <= 0.0:
        return 0.0, 0.0, 0.0
    if v < delta:
        return k * v**3 / (6.0 * delta), k * v * v / (2.0 * delta), k * v / delta
    return k * (0.5 * v * v - 0.5 * delta * v + delta * delta / 6.0), k * (v - 0.5 * delta), k


@numba.njit(cache=True)
def _add_pair(vertices, weights, matrix, first, second, blocks, count):  # type: ignore[no-untyped-def]
    for i in range(3):
        if weights[i] == 0.0:
            continue
        for j in range(3):
            a, b = vertices[i], vertices[j]
            if weights[j] == 0.0 or a > b:
                continue
            first[count], second[count] = a, b
            for r in range(3):
                for c in range(3):
                    blocks[count, r, c] = weights[i] * weights[j] * matrix[r, c]
            count += 1
    return count


@numba.njit(cache=True)
def _normal_contact(key, vertices, weights, direction, distance, gap, k, delta, n_points, gradient,  # type: ignore[no-untyped-def]
                    first, second, blocks):
    energy, penetration, hits, count = 0.0, 0.0, 0, 0
    force = np.zeros(n_points)
    matrix = np.empty((3, 3))
    for h in range(len(key)):
        phi, push, stiffness = _penalty(gap - distance[h], k, delta)
        if push == 0.0:
            continue
        hits += 1
        energy += phi
        penetration = max(penetration, gap - distance[h])
        force[key[h]] += push
        for r in range(3):
            for i in range(3):
                gradient[vertices[h, i], r] -= push * weights[h, i] * direction[h, r]
            for c in range(3):
                matrix[r, c] = stiffness * direction[h, r] * direction[h, c]
        count = _add_pair(vertices[h], weights[h], matrix, first, second, blocks, count)
    return energy, penetration, hits, count, force


@numba.njit(cache=True)
def _friction(force, anchored, vertices, weights, normal, start, slip0, now, mu, k, gradient,  # type: ignore[no-untyped-def]
              first, second, blocks, count):
    energy = 0.0
    slip = np.zeros_like(slip0)
    matrix = np.empty((3, 3))
    for p in range(len(force)):
        if force[p] <= 0.0 or not anchored[p]:
            continue
        n = normal[p]
        e = slip0[p] + (now[p] - start[p])
        e = e - n * (e[0] * n[0] + e[1] * n[1] + e[2] * n[2])
        size = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        limit = mu * force[p]
        if k * size <= limit:
            energy += 0.5 * k * size * size
            for r in range(3):
                for c in range(3):
                    matrix[r, c] = k * ((1.0 if r == c else 0.0) - n[r] * n[c])
                slip[p, r] = e[r]
        else:
            energy += limit * (size - 0.5 * limit / k)
            u = e / size
            for r in range(3):
                for c in range(3):
                    matrix[r, c] = limit / size * ((1.0 if r == c else 0.0) - n[r] * n[c] - u[r] * u[c])
                slip[p, r] = limit / k * u[r]
        for i in range(3):
            for r in range(3):
                gradient[vertices[p, i], r] += k * slip[p, r] * weights[p, i]
        count = _add_pair(vertices[p], weights[p], matrix, first, second, blocks, count)
    return energy, slip, count


@dataclass(frozen=True, eq=False)
class ContactModel:
    """Contact of one probe with one skin.

    Contact points are numbered: the probe's samples first, then the skin's vertices.
    """

    skin: SkinSurface
    probe: ProbeSurface
    config: ContactConfig = field(default_factory=ContactConfig)

    @property
    def n_points(self) -> int:
        """Number of contact points."""
        return len(self.probe.samples) + len(self.skin.nodes)

    def near(self, vertices: FloatArray, pose: ProbePose, cutoff: float) -> tuple[Proximity, Proximity, FloatArray, FloatArray]:
        """Pairs within `cutoff`: probe samples against skin, skin vertices against probe; and the placed probe."""
        samples, corners = pose.place(self.probe.samples), pose.place(self.probe.vertices)
        first = proximity(samples, vertices, self.skin.surface, cutoff=cutoff)
        low, high = corners.min(axis=0) - cutoff, corners.max(axis=0) + cutoff
        close = np.flatnonzero(((vertices >= low) & (vertices <= high)).all(axis=1))
        second = proximity(vertices[close], corners, self.probe.surface, cutoff=cutoff)
        second = Proximity(close[second.point], second.triangle, second.weights, second.distance)
        return first, second, samples, corners

    def _pairs(self, vertices: FloatArray, pose: ProbePose, cutoff: float) -> tuple[
        IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray,
    ]:
        """All pairs alike: contact point, skin vertices and weights, direction, distance, place on the probe."""
        first, second, samples, corners = self.near(vertices, pose, cutoff)
        stencil = np.concatenate([
            self.skin.surface.triangles[first.triangle], np.repeat(second.point[:, None], 3, axis=1),
        ])
        weights = np.concatenate([first.weights, np.tile([1.0, 0.0, 0.0], (len(second), 1))])
        on_probe = np.concatenate([
            samples[first.point],
            np.einsum("hc,hck->hk", second.weights, corners[self.probe.surface.triangles[second.triangle]]),
        ])
        distance = np.concatenate([first.distance, second.distance])
        on_skin = np.einsum("hc,hck->hk", weights, vertices[stencil])
        direction = (on_skin - on_probe) / np.maximum(distance, 1e-12)[:, None]
        key = np.concatenate([first.point, len(self.probe.samples) + second.point])
        return key, stencil, weights, direction, distance, on_probe

    def begin_step(self, vertices: FloatArray, pose: ProbePose, slip: FloatArray | None) -> FrictionFrame:
        """Choose the material points that friction refers to, from the configuration at the start of a step.

        Args:
            vertices: skin vertex positions [mm], shape (v, 3).
            pose: of the probe, at the start of the step.
            slip: elastic slip at the end of the previous step [mm], shape (p, 3), or None at first.
        """
        n = self.n_points
        frame = FrictionFrame(
            np.zeros(n, dtype=bool), np.zeros((n, 3), dtype=np.int64), np.zeros((n, 3)), np.zeros((n, 3)),
            np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)) if slip is None else slip,
        )
        key, stencil, weights, direction, distance, on_probe = self._pairs(vertices, pose, self.config.alarm)
        order = np.argsort(-distance, kind="stable")  # the nearest pair of a contact point is written last
        key = key[order]
        frame.anchored[key] = True
        frame.vertices[key], frame.weights[key] = stencil[order], weights[order]
        frame.local[key] = (on_probe[order] - pose.translation) @ pose.rotation
        frame.normal[key] = direction[order]
        frame.start[key] = (direction * distance[:, None])[order]
        return frame

    def evaluate(self, vertices: FloatArray, pose: ProbePose, frame: FrictionFrame) -> ContactForces:
        """Energy, forces and stiffness at skin vertex positions `vertices` [mm], shape (v, 3)."""
        config = self.config
        key, stencil, weights, direction, distance, _ = self._pairs(vertices, pose, config.gap)
        capacity = 6 * (len(key) + int(frame.anchored.sum())) + 6
        first, second = np.empty(capacity, dtype=np.int64), np.empty(capacity, dtype=np.int64)
        blocks = np.empty((capacity, 3, 3))
        gradient = np.zeros_like(vertices)
        energy, penetration, hits, count, force = _normal_contact(
            key, stencil, weights, direction, distance, config.gap, config.stiffness, config.smoothing,
            self.n_points, gradient, first, second, blocks,
        )
        slip = np.zeros_like(frame.slip)
        if config.friction > 0.0 and hits:
            now = np.einsum("pc,pck->pk", frame.weights, vertices[frame.vertices]) - pose.place(frame.local)
            stored, slip, count = _friction(
                force, frame.anchored, frame.vertices, frame.weights, frame.normal, frame.start, frame.slip, now,
                config.friction, config.stiffness, gradient, first, second, blocks, count,
            )
            energy += stored
        return ContactForces(
            energy, gradient, first[:count], second[:count], blocks[:count], slip, force, penetration, hits,
        )
