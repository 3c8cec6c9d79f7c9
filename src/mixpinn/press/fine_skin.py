"""FineSkin: the force with which a placed probe presses on skin that is finer than the faces of the model's own mesh.

Faces of the own mesh are as large as a probe is wide: where its edge lies between their nodes changes the force of a
press by a tenth and more. So the skin has finer faces here, whose nodes yield along y by

    C = P W Pᵀ + L,

with W the compliance of the own nodes along y, P the shape functions of their faces, and L what finer cells yield
besides. L falls off within an element or two, and is kept for nodes that lie close to each other. The force is that of
contact without friction along one direction, the unique minimum over p ≥ 0, the forces on points of the skin, of

    ½ (Sᵀp)ᵀ C (Sᵀp) + ½ pᵀ K⁻¹ p − δᵀp,

where S are shape functions at the points, K is the stiffness of contact there, and δ how far the probe has come upon
each along its axis. It is found by conjugate gradients with a bound (I. A. Polonsky and L. M. Keer, Wear 231, 1999).
What friction, slopes and large strains add is learned (`mixpinn.press.force_law`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
import scipy.sparse as sp

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.validated import ArraySpec
from mixpinn.physics.elimination import symmetric_times
from mixpinn.physics.face_points import FacePoints
from mixpinn.press.first_touch import mark_shadow, touch_depths
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.skin_points import SkinPoints
from mixpinn.reduced.prior import ElasticPrior

ALONG = 1
"""Skin is probed along y: the component of displacements and forces that counts here."""
_SPACING = 5.0
"""Points of the skin lie about so far apart [mm]: twelve on most faces with edges up to 14 mm. With three, in half the
time, forces in the first millimetre were a third farther off (patient1, 13 unseen positions)."""
_TOLERANCE = 1e-3
"""Of the violations of the gap, relative to δ; forces are then known to about a thousandth."""
_MOST = 200
"""Iterations; 20 to 50 are usual."""

_FORM = {
    "places": ArraySpec("number", ("nodes", 3)), "faces": ArraySpec("index", ("t", 6), low=0),
    "stencil": ArraySpec("index", ("nodes", 6), low=0), "weights": ArraySpec("number", ("nodes", 6)),
    "starts": ArraySpec("index", ("ends",), low=0), "others": ArraySpec("index", ("pairs",), low=0),
    "more": ArraySpec("number", ("pairs",)),
}

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@dataclass(frozen=True, eq=False)
class FineSkin:
    """Finer faces on the candidates' skin; n nodes on t faces, e close pairs of nodes.

    Attributes:
        places: rest positions of the nodes [mm], shape (n, 3).
        faces: nodes of each, with the midpoints of its edges, shape (t, 6).
        stencil: own nodes behind each node, by number among the candidates, shape (n, 6).
        weights: P, shape functions there, shape (n, 6).
        starts: where the pairs of each node begin, and their number, shape (n + 1,).
        others: the other node of each pair, ascending for each node, shape (e,).
        more: L of each pair [mm/N], shape (e,).
    """

    places: FloatArray
    faces: IntArray
    stencil: IntArray
    weights: Float32Array
    starts: IntArray
    others: IntArray
    more: Float32Array

    @staticmethod
    def of_compliance(
        places: FloatArray, faces: IntArray, stencil: IntArray, weights: AnyArray, *, compliance: FloatArray,
        own: AnyArray, near: sp.coo_matrix,
    ) -> "FineSkin":
        """Keep the part of a `compliance` (n, n) [mm/N] that `own` (c, c), of the candidates, does not have.

        Args:
            places, faces, stencil, weights: as the attributes.
            compliance: of the nodes along y.
            own: of the candidates along y.
            near: its entries are the pairs that are kept; shape (n, n).
        """
        rows = np.repeat(np.arange(len(places)), stencil.shape[1])
        shape = sp.csr_matrix((weights.ravel(), (rows, stencil.ravel())), shape=(len(places), len(own)))
        rest = compliance - (shape @ (shape @ np.asarray(own, dtype=np.float64)).T).T
        pairs = sp.csr_matrix((np.ones(near.nnz), (near.row, near.col)), shape=near.shape)
        pairs.setdiag(1.0)
        pairs.sort_indices()
        first = np.repeat(np.arange(len(places)), np.diff(pairs.indptr))
        return FineSkin(
            places, faces, stencil, weights.astype(np.float32), pairs.indptr.astype(np.int64),
            pairs.indices.astype(np.int64), rest[first, pairs.indices].astype(np.float32),
        )

    def arrays(self) -> dict[str, AnyArray]:
        """All of it by name, small."""
        return {
            "places": self.places, "weights": self.weights, "more": self.more,
            **{name: getattr(self, name).astype(np.int32) for name in ("faces", "stencil", "starts", "others")},
        }

    @staticmethod
    def of_arrays(arrays: Mapping[str, AnyArray], *, candidates: int, where: str, remake: str) -> "FineSkin":
        """From what `arrays` gave.

        Args:
            arrays: by name.
            candidates: their number c.
            where: for the message.
            remake: what a user does where they are damaged.

        Raises:
            InputError: one is absent, or an index points to nothing.
        """
        for name in _FORM:
            if name not in arrays:
                raise InputError(where, expected=f"the array '{name}' of the finer skin", got="none", fix=remake)
        nodes, pairs = len(arrays["places"]), len(arrays["others"])
        most = {"faces": nodes - 1, "stencil": candidates - 1, "starts": pairs, "others": nodes - 1}
        extents = {"nodes": nodes, "ends": nodes + 1, "pairs": pairs}
        for name, spec in _FORM.items():
            spec = replace(spec, high=most.get(name))
            spec.check(arrays[name], f"{where}: {name}", extents=extents, remake=remake)
        ends = arrays["starts"].astype(np.int64)
        if ends[0] != 0 or ends[-1] != pairs or (np.diff(ends) < 0).any():
            raise InputError(
                f"{where}: starts", expected="pairs of nodes that begin one after the other", got="others", fix=remake,
            )
        whole = {name: arrays[name].astype(np.int64) for name in ("faces", "stencil", "starts", "others")}
        return FineSkin(
            arrays["places"].astype(np.float64), whole["faces"], whole["stencil"],
            arrays["weights"].astype(np.float32), whole["starts"], whole["others"], arrays["more"].astype(np.float32),
        )


class FineContact:
    """Presses probes on a `FineSkin`. Nothing in here changes once it is made, so that threads may share it."""

    def __init__(self, skin: FineSkin, own: AnyArray, *, stiffness: float) -> None:
        """Prepare.

        Args:
            skin: the finer faces.
            own: W, compliance of the candidates along y [mm/N], shape (c, c).
            stiffness: of contact [N/mm/mm²].
        """
        self.skin, self._own = skin, np.ascontiguousarray(own, dtype=np.float32)
        points = FacePoints.build(skin.faces, skin.places[skin.faces[:, :3]], spacing=_SPACING)
        self._points = SkinPoints(
            np.ascontiguousarray(points.vertices, dtype=np.int64), np.ascontiguousarray(points.weights), points.area,
            points.face,
        )
        self._soft = 1.0 / (stiffness * points.area)
        self._places = np.einsum("pw,pwk->pk", points.weights, skin.places[points.vertices])
        self._balls = self._points.balls(self._places, len(skin.faces))

    @staticmethod
    def of_prior(skin: FineSkin, prior: ElasticPrior, *, stiffness: float) -> "FineContact":
        """On the candidates of a prior."""
        return FineContact(skin, own_along(prior), stiffness=stiffness)

    def push(self, probes: Sequence[ProbeField], rotations: FloatArray, translations: FloatArray) -> FloatArray:
        """Force of each of k placed probes along y [N], shape (k,); zero where it reaches no skin.

        Args:
            probes: k of them, all pressing at the same time.
            rotations: of each, shape (k, 3, 3).
            translations: position of each tip [mm], shape (k, 3).
        """
        depth, owner = self._upon(probes, rotations, translations)
        under = np.flatnonzero(owner >= 0)
        if not len(under):
            return np.zeros(len(probes))
        nodes, stencil = np.unique(self._points.stencil[under], return_inverse=True)
        stencil = stencil.reshape(len(under), -1)
        skin, weights = self.skin, self._points.weights[under]
        yielding = _compliance(nodes, self._own, skin.stencil, skin.weights, skin.starts, skin.others, skin.more)
        force = _pressed(yielding, stencil, weights, self._soft[under], depth[under])
        found: FloatArray = np.bincount(owner[under], weights=force, minlength=len(probes)).astype(np.float64)
        return found

    def _upon(
        self, probes: Sequence[ProbeField], rotations: FloatArray, translations: FloatArray,
    ) -> tuple[FloatArray, IntArray]:
        """δ of every point [mm] and the probe that has come upon it, −1 for none, shapes (p,)."""
        depth, owner = np.zeros(len(self._places)), np.full(len(self._places), -1)
        for k, probe in enumerate(probes):
            turn, tip = np.ascontiguousarray(rotations[k]), np.ascontiguousarray(translations[k])
            low, near = probe.origin[[0, 2]], np.zeros(len(self.skin.faces), dtype=bool)
            high = low + probe.spacing * (np.array(probe.underside.shape) - 1.0)
            mark_shadow(self._places, *self._balls, turn, tip, low, high, near)
            some = self._points.on_faces(np.flatnonzero(near))
            here = np.empty(len(some))
            touch_depths(self._places[some], turn, tip, probe.underside, probe.origin, probe.spacing, here)
            deeper = here > depth[some]
            depth[some[deeper]], owner[some[deeper]] = here[deeper], k
        return depth, owner


def own_along(prior: ElasticPrior) -> Float32Array:
    """Compliance of a prior's candidates along y [mm/N], shape (c, c)."""
    found: Float32Array = np.ascontiguousarray(prior.own_compliance[ALONG::3, ALONG::3], dtype=np.float32)
    return found


@numba.njit(cache=True, nogil=True)
def _compliance(nodes, own, stencil, weights, starts, others, more):  # type: ignore[no-untyped-def]
    """P W Pᵀ + L among some nodes, ascending, (a, a)."""
    a, wide = len(nodes), stencil.shape[1]
    local = np.full(len(own), -1)
    for i in range(a):
        for w in range(wide):
            local[stencil[nodes[i], w]] = 0
    behind = np.flatnonzero(local >= 0)
    for j in range(len(behind)):
        local[behind[j]] = j
    half = np.zeros((a, len(behind)))
    for i in range(a):
        for w in range(wide):
            share, row = weights[nodes[i], w], own[stencil[nodes[i], w]]
            if share != 0.0:
                for j in range(len(behind)):
                    half[i, j] += share * row[behind[j]]
    found = np.empty((a, a))
    for j in range(a):
        for i in range(j, a):
            total = 0.0
            for w in range(wide):
                total += weights[nodes[j], w] * half[i, local[stencil[nodes[j], w]]]
            found[i, j] = found[j, i] = total
    at = np.full(len(starts) - 1, -1)
    for i in range(a):
        at[nodes[i]] = i
    for i in range(a):
        for e in range(starts[nodes[i]], starts[nodes[i] + 1]):
            j = at[others[e]]
            if j >= 0:
                found[i, j] += more[e]
    return found


@numba.njit(cache=True, nogil=True)
def _yield(compliance, stencil, weights, soft, force, nodal, out):  # type: ignore[no-untyped-def]
    """S C Sᵀ p + K⁻¹ p into `out` (p,); `nodal` (a,) is scratch."""
    nodal[:] = 0.0
    for p in range(len(force)):
        if force[p] != 0.0:
            for w in range(stencil.shape[1]):
                nodal[stencil[p, w]] += weights[p, w] * force[p]
    moved = np.empty(len(nodal))
    symmetric_times(compliance, nodal, moved)
    for p in range(len(force)):
        total = soft[p] * force[p]
        for w in range(stencil.shape[1]):
            total += weights[p, w] * moved[stencil[p, w]]
        out[p] = total


@numba.njit(cache=True, nogil=True)
def _pressed(compliance, stencil, weights, soft, depth):  # type: ignore[no-untyped-def]
    """Forces p ≥ 0 on points (p,) that the probe has come upon by `depth`, see the module."""
    count = len(depth)
    force, way, gap = np.zeros(count), np.zeros(count), -depth
    answer, nodal = np.empty(count), np.empty(len(compliance))
    limit = _TOLERANCE * _TOLERANCE * (depth * depth).sum()
    before, grown = 1.0, True
    for _ in range(_MOST):
        left = 0.0
        for p in range(count):
            if force[p] > 0.0 or gap[p] < 0.0:
                left += gap[p] * gap[p]
        if left <= limit:
            break
        ratio = 0.0 if grown else left / before
        before = left
        for p in range(count):
            way[p] = gap[p] + ratio * way[p] if force[p] > 0.0 or gap[p] < 0.0 else 0.0
        _yield(compliance, stencil, weights, soft, way, nodal, answer)
        up, down = 0.0, 0.0
        for p in range(count):
            up += gap[p] * way[p]
            down += way[p] * answer[p]
        if not down > 0.0:
            break
        length, grown = up / down, False
        cut = False
        for p in range(count):
            was = force[p]
            now = was - length * way[p]
            if now < 0.0:
                now, cut = 0.0, True
            if was == 0.0 and now > 0.0:
                grown = True
            force[p] = now
        if cut:
            _yield(compliance, stencil, weights, soft, force, nodal, answer)
            for p in range(count):
                gap[p] = answer[p] - depth[p]
        else:
            for p in range(count):
                gap[p] -= length * answer[p]
    return force
