"""Contact from the probe's pose alone, solved on the compliance of the elastic prior.

The body is linear (`mixpinn.reduced.prior`): forces f on the skin's nodes move them by W f. Contact acts on points
fixed to the skin (`mixpinn.press.skin_points`) by their distance from the probe (`mixpinn.press.probe_field`), with a
smooth penalty and Coulomb friction (`mixpinn.press.path_kernel`). Nothing is paired: what a point feels depends on its
place alone, and steadily.

Friction has a past. Without a history the answer to a pose is that of the straight path along the pressing direction
from first touch to there, in steps of a fixed length counted from first touch, the last one shorter: the answers along
such a path are those of one path, and an answer depends on nothing asked before. With the history of an earlier answer
the path begins there and goes straight to the pose asked for.

A step that does not converge is divided, again and again. Where that does not help, it is taken without friction, which
an energy then governs, and the answer says that it did not converge.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.press.first_touch import deepest_touch, mark_shadow
from mixpinn.press.probe_field import ProbeField, shadow_columns
from mixpinn.press.records import (
    ContactHistory,
    ContactPrediction,
    PlacedFields,
    PoseContactConfig,
    check_poses,
)
from mixpinn.press.session import ContactSession
from mixpinn.press.skin_points import SkinPoints
from mixpinn.records import Probe, TissueMesh
from mixpinn.reduced.compliance.row_products import block_of
from mixpinn.reduced.prior import ElasticPrior

_CUTS = 5
"""A step may be halved so often."""
_SOME_FORCE = 1e-9
"""A history tells which points were pushed, not how much: a force that only says so [N]."""
_BACKWARDS = 0.2
"""Skin whose unit normal has more than this along y goes on; what is turned farther away is an end of the body."""
_EDGES = {3: ((0, 1), (1, 2), (2, 0)), 6: ((0, 1, 3), (1, 2, 4), (2, 0, 5))}
"""Edges of a face by its number of nodes: both ends, and the midpoint where there is one."""


class PriorContact:
    """Solves contact of probes with the skin of a linear body.

    Poses are independent of each other unless a history is handed over. Nothing in here changes once it is made, so
    that threads may share it.
    """

    def __init__(
        self, points: FloatArray, faces: IntArray, nodes: IntArray, compliance: FloatArray,
        config: PoseContactConfig | None = None, *, goes_on: IntArray | None = None,
    ) -> None:
        """Prepare.

        Args:
            points: rest positions of the mesh's nodes [mm], shape (n, 3).
            faces: of the skin between candidate contact nodes, by mesh node, shape (t, 3), or (t, 6) with the
                midpoints of their edges.
            nodes: candidate contact nodes, ascending, shape (c,).
            compliance: displacement of the candidates under unit forces on them [mm/N], symmetric, shape (3 c, 3 c).
            config: how contact is solved.
            goes_on: mesh nodes from which the skin that may be touched goes on beyond the candidates; None where that
                is not known. The rim of the candidates is no rim of the skin where the body ends.
        """
        self.config, self.cuts = config or PoseContactConfig(), _CUTS
        self.nodes = np.asarray(nodes, dtype=np.int64)
        self.rest = np.ascontiguousarray(points[self.nodes])
        self._faces = np.searchsorted(self.nodes, faces).astype(np.int64)
        self._compliance = compliance
        self.skin = SkinPoints.of_faces(self.rest, self._faces, spacing=self.config.spacing)
        self._places = np.einsum("pw,pwk->pk", self.skin.weights, self.rest[self.skin.stencil])
        self._starts, self._balls = self.skin.balls(self._places, len(self._faces))
        edges = np.concatenate([self._faces[:, pair] for pair in _EDGES[self._faces.shape[1]]])
        _, first, count = np.unique(np.sort(edges[:, :2], axis=1), axis=0, return_index=True, return_counts=True)
        rim = edges[first[count == 1]]
        if goes_on is not None:
            rim = rim[np.isin(self.nodes[rim], goes_on).all(axis=1)]
        self._beside_rim = _close(self._places, self.rest[rim[:, :2]], 0.5 * self.config.spacing)

    @staticmethod
    def of_prior(prior: ElasticPrior, config: PoseContactConfig | None = None) -> "PriorContact":
        """Contact on the nodes of `prior`."""
        return PriorContact(
            prior.mesh.node_points, candidate_faces(prior.mesh, prior.nodes), prior.nodes,
            prior.own_compliance, config, goes_on=_beyond(prior.mesh, prior.nodes),
        )

    def at_the_rim(self, contact: ContactPrediction) -> bool:
        """Whether the probe pushes points so close to the rim of the candidates' skin that it may push others beyond.

        Nodes tell less: each of a face carries force, wherever in the face the probe pushes.
        """
        return bool(self._beside_rim[contact.history.point].any())

    def field(self, probe: Probe) -> ProbeField:
        """The distance from a probe, as `solve` wants it."""
        return ProbeField.of_probe(probe, gap=self.config.gap)

    def solve(
        self, probes: Sequence[ProbeField], rotations: AnyArray, translations: AnyArray,
        history: ContactHistory | None = None,
    ) -> ContactPrediction:
        """Contact of `probes` at the given poses.

        Args:
            probes: one or more, all pressing at the same time.
            rotations: of each, shape (k, 3, 3).
            translations: position of each tip [mm], shape (k, 3).
            history: of an earlier call with the same probes. None: each probe came straight along its axis.

        Raises:
            InputError: not as many poses as probes, a pose that is no rotation or not finite, or another history.
        """
        return self.open(probes, rotations, translations, history).outcome()

    def depth(self, probes: Sequence[ProbeField], rotations: AnyArray, translations: AnyArray) -> FloatArray:
        """How far each probe has come along its axis since it first touched the resting skin [mm], shape (k,).

        Negative before first touch; −inf where no skin lies in its way.

        Raises:
            InputError: as `solve`.
        """
        rotations, translations = check_poses(len(probes), rotations, translations)
        return np.array([
            self._touch(probe, rotation, translation)
            for probe, rotation, translation in zip(probes, rotations, translations, strict=True)
        ])

    def open(
        self, probes: Sequence[ProbeField], rotations: AnyArray, translations: AnyArray,
        history: ContactHistory | None = None, *, check: Callable[[FloatArray], None] | None = None,
    ) -> ContactSession:
        """Contact at the given poses, as a session that goes on from there. Arguments and errors are `solve`'s.

        `check` is told the depths beyond first touch (see `depth`) before anything is solved, and may refuse.
        """
        rotations, translations = check_poses(len(probes), rotations, translations)
        if history is not None and len(history.translations) != len(probes):
            raise InputError(
                "history", expected=f"one of {len(probes)} probes", got=f"one of {len(history.translations)}",
                fix="carry the history of the same probes, or none",
            )
        placed = PlacedFields(tuple(probes), rotations, translations)
        if history is not None and not history.force.any():
            history = None  # what has touched nothing has no past
        depths = np.array([self._touch(*place) for place in zip(probes, rotations, translations, strict=True)])
        if check is not None:
            check(depths)
        near = np.zeros(len(self._faces), dtype=bool)
        for probe, rotation, translation, depth in zip(probes, rotations, translations, depths, strict=True):
            self._shadow(probe, rotation, translation, depth, near)
        if history is not None:
            for probe, rotation, translation in zip(probes, history.rotations, history.translations, strict=True):
                self._shadow(probe, rotation, translation, self._touch(probe, rotation, translation), near)
            near |= (history.force != 0.0).any(axis=1)[self._faces].any(axis=1)
        session = self._session(placed, np.flatnonzero(near), depths, history)
        if history is None:
            way = self._path_down(placed, depths)
            return replace(session, way=way).go(way)
        return session.go(self._path_from(history, placed))

    def _session(
        self, placed: PlacedFields, faces: IntArray, depths: FloatArray, history: ContactHistory | None,
    ) -> ContactSession:
        """Before anything is solved: the patch of skin, and the state that the history tells."""
        chosen = self.skin.on_faces(faces)
        patch = np.unique(self._faces[faces])
        local = np.full(len(self.nodes), -1, dtype=np.int64)
        local[patch] = np.arange(len(patch))
        rows = (3 * patch[:, None] + np.arange(3)).ravel()
        k, nothing = len(placed.fields), np.zeros((len(patch), 3))
        slip, lead, push = np.zeros((k, len(chosen), 3)), np.zeros((k, len(chosen))), np.zeros((k, len(chosen)))
        force, shift, where = nothing.ravel(), nothing, placed
        if history is not None:
            force, shift = history.force[patch].ravel(), history.shift[patch]
            contacts = history.probe, np.searchsorted(chosen, history.point)
            slip[contacts], lead[contacts] = history.slip, history.lead
            push[contacts] = _SOME_FORCE
            where = replace(placed, rotations=history.rotations, translations=history.translations)
        return ContactSession(
            self, where, patch, chosen, local[self.skin.stencil[chosen]],
            block_of(self._compliance, rows), depths, shift, force, slip, lead,
            push, np.zeros((k, len(chosen), 3)), True, 0,
        )

    def _touch(self, probe: ProbeField, rotation: FloatArray, translation: FloatArray) -> float:
        """How far beyond the underside of a placed probe the resting skin comes at most [mm]."""
        return float(deepest_touch(
            self._places, self._starts, self._balls, rotation, translation, probe.underside, probe.origin,
            probe.spacing,
        ))

    def _shadow(
        self, probe: ProbeField, rotation: FloatArray, translation: FloatArray, touch: float, near: BoolArray,
    ) -> None:
        """Flag in `near` (t,) each triangle that may be touched on the way to a pose: it lies near the shadow."""
        columns = shadow_columns(probe, self.config.deepest)
        if columns is not None and touch > -self.config.reach:
            low = probe.origin[[0, 2]] + probe.spacing * columns[0] - self.config.margin
            high = probe.origin[[0, 2]] + probe.spacing * columns[1] + self.config.margin
            mark_shadow(self._places, self._starts, self._balls, rotation, translation, low, high, near)

    def _path_down(self, placed: PlacedFields, depths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The straight way down, from first touch of the first probe that touches: placements before and after steps.

        A probe that touches later waits at first touch.
        """
        deepest = float(depths.max(initial=-np.inf))
        if not deepest > 0.0:
            return placed.rotations[None], placed.translations[None]
        step = self.config.step
        reached = np.append(np.arange(0.0, deepest - 1e-9, step), deepest)
        back = np.minimum(deepest - reached[:, None], np.maximum(depths, 0.0))
        axes = placed.rotations @ PROBE_AXIS
        return (
            np.repeat(placed.rotations[None], len(reached), axis=0),
            placed.translations - back[..., None] * axes,
        )

    def _path_from(self, history: ContactHistory, placed: PlacedFields) -> tuple[FloatArray, FloatArray]:
        """The way from the poses of a history: straight, turning steadily."""
        turn = vector_from_rotation(placed.rotations @ history.rotations.transpose(0, 2, 1))
        way = placed.translations - history.translations
        far = np.linalg.norm(way, axis=1) + np.linalg.norm(turn, axis=1) * self.config.arm
        steps = int(np.clip(np.ceil(far.max() / self.config.step - 1e-9), 1, self.config.most_steps))
        share = np.linspace(0.0, 1.0, steps + 1)
        rotations = rotation_from_vector(share[:, None, None] * turn) @ history.rotations
        rotations[-1] = placed.rotations
        translations = history.translations + share[:, None, None] * way
        translations[-1] = placed.translations
        return rotations, translations


def _close(places: FloatArray, edges: FloatArray, distance: float) -> BoolArray:
    """Which of some places (p, 3) lie within a distance of one of the edges (e, 2, 3) [mm], shape (p,)."""
    found = np.zeros(len(places), dtype=bool)
    for start, end in edges:
        way = end - start
        share = np.clip((places - start) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
        found |= np.linalg.norm(places - start - share[:, None] * way, axis=1) <= distance
    return found


def candidate_faces(mesh: TissueMesh, nodes: IntArray) -> IntArray:
    """Faces of the skin of `mesh` whose nodes are all among `nodes`, by mesh node, shape (t, 3) or (t, 6)."""
    faces = np.asarray(mesh.skin_node_faces, dtype=np.int64)
    return faces[np.isin(faces, nodes).all(axis=1)]


def _beyond(mesh: TissueMesh, nodes: IntArray) -> IntArray:
    """Nodes of the faces of the skin that are turned backwards as the probed ones are, but not all `nodes`."""
    a, b, c = (mesh.points[mesh.skin_faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    backwards = normal[:, 1] > _BACKWARDS * np.linalg.norm(normal, axis=1)
    others = ~np.isin(mesh.skin_node_faces, nodes).all(axis=1)
    found: IntArray = np.unique(mesh.skin_node_faces[backwards & others])
    return found
