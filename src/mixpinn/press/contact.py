"""Contact from the probe's pose alone, solved on the compliance of the elastic prior.

The body is linear (`mixpinn.reduced.prior`): forces f on the skin's nodes move them by W f. A probe that came straight
along its axis meets the skin along lines parallel to it. These lines pair probe points with skin triangles and skin
nodes with probe triangles, and say on which side of the skin the probe is, however deep it stands: the contact of a
pose is found in one go, without the path that led there. With the pairs and their normals held, contact with Coulomb
friction is a small problem that is linear piece by piece (`mixpinn.press.kernel`); it is solved a few times, with
pairs and normals renewed at the skin found last.

Friction refers to the point of the probe that a place of the skin touches first. Skin is drawn sideways before it is
touched, and so the way down is divided into a few sub-steps. A history, if given, replaces this way: what touched
before keeps its grip, slid as far as friction let it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.press.kernel import cast_along, pair_contacts, shadowed, solve_contacts
from mixpinn.press.records import (
    NO_GRIP,
    ContactHistory,
    ContactPrediction,
    Grip,
    PlacedProbe,
    PoseContactConfig,
    ProbeGeometry,
    check_poses,
)
from mixpinn.records import TissueMesh
from mixpinn.reduced.prior import ElasticPrior

AXIS = np.array([0.0, -1.0, 0.0])
"""The direction in which a probe presses, in its own frame."""


class PriorContact:
    """Solves contact of probes with the skin of a linear body.

    Poses are independent of each other unless a history is handed over.
    """

    def __init__(
        self, points: FloatArray, triangles: IntArray, nodes: IntArray, compliance: FloatArray,
        config: PoseContactConfig | None = None,
    ) -> None:
        """Prepare.

        Args:
            points: rest positions of the mesh's nodes [mm], shape (n, 3).
            triangles: skin triangles between candidate contact nodes, by mesh node, shape (t, 3).
            nodes: candidate contact nodes, ascending, shape (c,).
            compliance: displacement of the candidates under unit forces on them [mm/N], symmetric, shape (3 c, 3 c).
            config: how contact is solved.
        """
        self.config = config or PoseContactConfig()
        self.nodes = np.asarray(nodes, dtype=np.int64)
        self._rest = np.ascontiguousarray(points[self.nodes])
        self._triangles = np.searchsorted(self.nodes, triangles).astype(np.int64)
        self._compliance = compliance
        c = self.config
        self.law = (c.stiffness, c.stiffness, c.friction, c.smoothing)

    @staticmethod
    def of_prior(prior: ElasticPrior, config: PoseContactConfig | None = None) -> "PriorContact":
        """Contact on the nodes of `prior`."""
        return PriorContact(
            prior.mesh.points, candidate_triangles(prior.mesh, prior.nodes), prior.nodes,
            prior.own_compliance, config,
        )

    def solve(
        self, probes: Sequence[ProbeGeometry], rotations: AnyArray, translations: AnyArray,
        history: ContactHistory | None = None,
    ) -> ContactPrediction:
        """Contact of `probes` at the given poses.

        Args:
            probes: one or more, all pressing at the same time.
            rotations: of each, shape (k, 3, 3).
            translations: position of each tip [mm], shape (k, 3).
            history: of an earlier call with the same probes near these poses. None: each probe came straight along
                its axis, and the result depends on nothing asked before.

        Raises:
            InputError: not as many poses as probes, a pose that is no rotation or not finite, or another history.
        """
        return self.open(probes, rotations, translations, history).solve()

    def open(
        self, probes: Sequence[ProbeGeometry], rotations: AnyArray, translations: AnyArray,
        history: ContactHistory | None = None,
    ) -> "ContactSession":
        """Go down to just above the given poses, so that the last part of the way can be solved more than once.

        Arguments and errors are those of `solve`.
        """
        rotations, translations = check_poses(len(probes), rotations, translations)
        if history is not None and len(history.grips) != len(probes):
            raise InputError(
                "history", expected=f"one of {len(probes)} probes", got=f"one of {len(history.grips)}",
                fix="carry the history of the same probes, or none",
            )
        axes = rotations @ AXIS
        patch, triangles = self._patch(probes, rotations, translations, axes, history)
        rows = (3 * patch[:, None] + np.arange(3)).ravel()
        compliance = np.ascontiguousarray(self._compliance[rows[:, None], rows])
        rest = self._rest[patch]
        force = np.zeros(3 * len(patch)) if history is None else history.force[patch].ravel()
        grips = tuple(NO_GRIP for _ in probes) if history is None else history.grips
        session = ContactSession(self, [], rest, patch, triangles, compliance, grips, force, True, 0)
        substeps = self.config.substeps if history is None else 1
        depths = np.array([
            self._depth(probe, rotation, translation, axis, rest, triangles)
            for probe, rotation, translation, axis in zip(probes, rotations, translations, axes, strict=True)
        ]) if substeps > 1 else np.zeros(len(probes))
        for step in range(1, substeps + 1):
            back = (1.0 - step / substeps) * np.maximum(depths, 0.0)
            placed = [
                PlacedProbe(probe, rotation, translation, axis) for probe, rotation, translation, axis
                in zip(probes, rotations, translations - back[:, None] * axes, axes, strict=True)
            ]
            session = replace(session, placed=placed)
            if step < substeps:
                solved = session.rounds(rest, force)
                force, grips = solved.force, solved.grips(placed, self.nodes[patch], rest)
                session = replace(
                    session, force=force, grips=grips, converged=session.converged and solved.converged,
                    iterations=session.iterations + solved.used,
                )
        return session

    def _patch(
        self, probes: Sequence[ProbeGeometry], rotations: FloatArray, translations: FloatArray, axes: FloatArray,
        history: ContactHistory | None,
    ) -> tuple[IntArray, IntArray]:
        """Candidates in the shadows of the probes, by index, and the triangles between them, by index into these."""
        near = np.zeros(len(self._triangles), dtype=bool)
        keep = np.zeros(len(self.nodes), dtype=bool)
        for probe, rotation, translation, axis in zip(probes, rotations, translations, axes, strict=True):
            near |= shadowed(
                probe.samples @ rotation.T + translation, self._rest, self._triangles, axis,
                self.config.margin, self.config.gap + self.config.reach,
            )
        if history is not None:
            keep |= (history.force != 0.0).any(axis=1)
            for grip in history.grips:
                keep[np.searchsorted(self.nodes, grip.nodes.ravel())] = True
        keep[self._triangles[near].ravel()] = True
        patch = np.flatnonzero(keep)
        local = np.full(len(self.nodes), -1, dtype=np.int64)
        local[patch] = np.arange(len(patch))
        triangles = local[self._triangles]
        return patch, np.ascontiguousarray(triangles[(triangles >= 0).all(axis=1)])

    def _depth(
        self, probe: ProbeGeometry, rotation: FloatArray, translation: FloatArray, axis: FloatArray, rest: FloatArray,
        triangles: IntArray,
    ) -> float:
        """How far the probe must be drawn back along its axis before nothing lies within the gap [mm]."""
        if not len(triangles):
            return 0.0
        samples, corners = probe.samples @ rotation.T + translation, probe.vertices @ rotation.T + translation
        hit, weights, height = np.empty(len(samples), np.int64), np.empty((len(samples), 3)), np.empty(len(samples))
        cast_along(samples, rest, triangles, axis, False, hit, weights, height)
        above = float(height[hit >= 0].max(initial=-np.inf))
        hit, weights, height = np.empty(len(rest), np.int64), np.empty((len(rest), 3)), np.empty(len(rest))
        cast_along(rest, corners, probe.triangles, axis, True, hit, weights, height)
        return max(above, float(-height[hit >= 0].min(initial=np.inf))) + self.config.gap


@dataclass(frozen=True, eq=False)
class ContactSession:
    """Probes at their poses, and all that leads there: patch of skin, its compliance, grips and forces before.

    Attributes:
        contact: whose candidates and settings these are.
        placed: the probes at the poses asked for.
        rest: rest positions of the patch [mm], shape (p, 3).
        patch: the patch by index into the candidates, shape (p,).
        triangles: of the patch, by index into it, shape (t, 3).
        compliance: of the patch, shape (3 p, 3 p).
        grips: before the last part of the way.
        force: gradient of contact before it, shape (3 p,).
        converged, iterations: of the solves so far.
    """

    contact: PriorContact
    placed: "list[PlacedProbe]"
    rest: FloatArray
    patch: IntArray
    triangles: IntArray
    compliance: FloatArray
    grips: tuple[Grip, ...]
    force: FloatArray
    converged: bool
    iterations: int

    @property
    def nodes(self) -> IntArray:
        """Mesh nodes of the patch, ascending, shape (p,)."""
        found: IntArray = self.contact.nodes[self.patch]
        return found

    def solve(self, shift: FloatArray | None = None, before: ContactPrediction | None = None) -> ContactPrediction:
        """Contact at the poses.

        Args:
            shift: where the patch would be without contact, relative to rest [mm], shape (p, 3); None for rest.
            before: a solve of this session; friction refers to the same places, and its forces are the first guess.
        """
        free = self.rest if shift is None else self.rest + shift
        if before is None:
            solved = self.rounds(free, self.force)
        else:
            start = before.history.force[self.patch].ravel()
            solved = replace(self, grips=before.pairs).rounds(free, start)
        moved = solved.y.reshape(-1, 3) if shift is None else solved.y.reshape(-1, 3) + shift
        grips = solved.grips(self.placed, self.nodes, free)
        return solved.prediction(
            self, moved, free, grips, self.converged and solved.converged, self.iterations + solved.used,
        )

    def rounds(self, free: FloatArray, force: FloatArray) -> "_Solved":
        """Pair and solve as often as the settings say, from first `force`."""
        solved, used, met = None, 0, True
        for _ in range(self.contact.config.rounds):
            solved = self._round(free, force)
            force, used, met = solved.force, used + solved.used, met and solved.converged
        assert solved is not None
        return replace(solved, used=used, converged=met)

    def _round(
        self, free: FloatArray, force: FloatArray,
    ) -> "_Solved":
        """Pair at the skin that `force` makes, and solve."""
        config = self.contact.config
        x = free - (self.compliance @ force).reshape(-1, 3)
        paired = [
            pair_contacts(
                *probe.placed(), probe.geometry.triangles, probe.axis, config.gap, config.reach, x, self.triangles,
                *self._held(probe, grip),
            ) for probe, grip in zip(self.placed, self.grips, strict=True)
        ]
        joined = [np.concatenate(parts) for parts in zip(*paired, strict=True)]
        force, y, push, slip, met, used = solve_contacts(
            free, self.compliance, force, *joined[1:], self.contact.law, config.tolerance, config.max_iterations,
        )
        owner = np.repeat(np.arange(len(paired)), [len(part[0]) for part in paired])
        return _Solved(force, y, joined, owner, push, slip, self.contact.law, met, used)

    def _held(
        self, probe: "PlacedProbe", grip: Grip,
    ) -> tuple[BoolArray, IntArray, FloatArray, FloatArray]:
        """The grip by contact point: which have one, place of the skin by index into the patch, placed anchor."""
        n_samples = len(probe.geometry.samples)
        n = n_samples + len(self.patch)
        held, vertices = np.zeros(n, dtype=np.bool_), np.zeros((n, 3), dtype=np.int64)
        weights, anchor = np.zeros((n, 3)), np.zeros((n, 3))
        if len(grip.point):
            nodes = self.nodes
            by_node = n_samples + np.searchsorted(nodes, np.maximum(-1 - grip.point, 0))
            key = np.where(grip.point >= 0, grip.point, by_node)
            held[key], vertices[key], weights[key] = True, np.searchsorted(nodes, grip.nodes), grip.weights
            anchor[key] = grip.anchor @ probe.rotation.T + probe.translation
        return held, vertices, weights, anchor


@dataclass(frozen=True, eq=False)
class _Solved:
    """One solve: forces and displacement of the patch, its contacts, the probe of each, their forces and slips."""

    force: FloatArray
    y: FloatArray
    contacts: list[AnyArray]
    owner: IntArray
    push: FloatArray
    slip: FloatArray
    law: tuple[float, float, float, float]
    converged: bool
    used: int

    def grips(
        self, placed: list[PlacedProbe], nodes: IntArray, free: FloatArray, *, before: bool = False,
    ) -> tuple[Grip, ...]:
        """What holds now: each place of the skin under force, its anchor moved on as far as it slid.

        With `before`, all places that were paired, and their anchors as they were.
        """
        key, _, _, stencil, weights = self.contacts[:5]
        x = free + self.y.reshape(-1, 3)
        anchors = self.contacts[7] if before else np.einsum("hc,hck->hk", weights, x[stencil]) - self.slip
        found = []
        for k, probe in enumerate(placed):
            on = np.flatnonzero((self.owner == k) & ((self.push > 0.0) | before))
            anchor = (anchors[on] - probe.translation) @ probe.rotation
            n_samples = len(probe.geometry.samples)
            vertex = nodes[np.clip(key[on] - n_samples, 0, len(nodes) - 1)]
            point = np.where(key[on] < n_samples, key[on], -1 - vertex)
            found.append(Grip(point, nodes[stencil[on]], weights[on], anchor))
        return tuple(found)

    def prediction(
        self, session: ContactSession, moved: FloatArray, free: FloatArray, grips: tuple[Grip, ...], converged: bool,
        iterations: int,
    ) -> ContactPrediction:
        """The outcome by mesh nodes and probes."""
        patch, nodes = session.patch, session.nodes
        _, stencil, weights, grip, grip_weights, normal = self.contacts[:6]
        x = free + self.y.reshape(-1, 3)
        _, k_t, mu, _ = self.law
        normal_force, friction = self.push[:, None] * normal, -k_t * self.slip
        wrench, sliding = np.zeros((len(grips), 6)), np.zeros(len(grips))
        for p in range(len(grips)):
            on = np.flatnonzero((self.owner == p) & (self.push > 0.0))
            for force, vertices, share in (
                (normal_force[on], stencil[on], weights[on]), (friction[on], grip[on], grip_weights[on]),
            ):
                arm = np.einsum("hc,hck->hk", share, x[vertices]) - session.placed[p].translation
                wrench[p, :3] -= force.sum(axis=0)
                wrench[p, 3:] -= np.cross(arm, force).sum(axis=0)
            slides = k_t * np.linalg.norm(self.slip[on], axis=1) >= mu * self.push[on] * (1.0 - 1e-9)
            sliding[p] = float(self.push[on][slides].sum()) / max(float(self.push[on].sum()), 1e-12)
        forces = -self.force.reshape(-1, 3)
        loaded = np.flatnonzero((forces != 0.0).any(axis=1))
        everywhere = np.zeros((len(session.contact.nodes), 3))
        everywhere[patch] = self.force.reshape(-1, 3)
        return ContactPrediction(
            nodes[loaded], moved[loaded], forces[loaded], self._shares(forces, len(grips))[:, loaded], wrench, sliding,
            self.grips(session.placed, nodes, free, before=True), ContactHistory(grips, everywhere), converged,
            iterations,
        )

    def _shares(self, forces: FloatArray, n_probes: int) -> FloatArray:
        """Forces of each probe on the patch [N], shape (k, p, 3)."""
        if n_probes == 1:
            return forces[None]
        _, stencil, weights, grip, grip_weights, normal = self.contacts[:6]
        shares = np.zeros((n_probes, *forces.shape))
        k_t = self.law[1]
        for force, vertices, share in (
            (self.push[:, None] * normal, stencil, weights), (-k_t * self.slip, grip, grip_weights),
        ):
            owner = np.repeat(self.owner[:, None], 3, axis=1)
            np.add.at(shares, (owner, vertices), share[:, :, None] * force[:, None, :])
        return shares


def candidate_triangles(mesh: TissueMesh, nodes: IntArray) -> IntArray:
    """Skin triangles of `mesh` whose corners are all among `nodes`, by mesh node, shape (t, 3)."""
    faces = np.asarray(mesh.skin_faces, dtype=np.int64)
    return faces[np.isin(faces, nodes).all(axis=1)]
