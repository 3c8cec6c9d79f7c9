"""Contact once more, from the probe's side and in plain NumPy: what the solver's compiled contact is held against.

Nothing of the compiled kernel is used. Places nearest to each other are found by projection on planes and edges, the
law of `mixpinn.fem.contact.model` is evaluated at each contact point, and the forces are summed over the points of the
probe instead of the nodes of the mesh. Friction acts on the surface that lies the gap outside the probe, where the
skin is.
"""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem.contact.model import ContactModel, FrictionFrame, ProbePose


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Forces on the skin at each of p contact points: the probe's samples, then the skin's vertices.

    Attributes:
        push: sum of the normal forces [N], shape (p, 3).
        size: sum of their magnitudes, which limits friction [N], shape (p,).
        friction: tangential force [N], shape (p, 3).
        push_moment: moment of the normal forces about the tip, taken where they leave the probe [N mm], shape (p, 3).
        friction_moment: the same of friction, shape (p, 3).
    """

    push: FloatArray
    size: FloatArray
    friction: FloatArray
    push_moment: FloatArray
    friction_moment: FloatArray

    def wrench_on_probe(self) -> FloatArray:
        """Force [N] and moment about the tip [N mm] of the skin on the probe, shape (6,)."""
        force = -(self.push + self.friction).sum(axis=0)
        return np.concatenate([force, -(self.push_moment + self.friction_moment).sum(axis=0)])


def nearest_places(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Place of triangle `corners` (h, 3, 3) nearest to `points` (h, 3), pair by pair [mm], shape (h, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    height = np.einsum("hk,hk->h", points - a, normal) / np.einsum("hk,hk->h", normal, normal)
    foot = points - height[:, None] * normal
    inside = np.ones(len(points), dtype=bool)
    best, least = foot.copy(), np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        inside &= np.einsum("hk,hk->h", np.cross(edge, foot - start), normal) >= 0.0
        along = np.einsum("hk,hk->h", points - start, edge) / np.einsum("hk,hk->h", edge, edge)
        place = start + np.clip(along, 0.0, 1.0)[:, None] * edge
        apart = np.linalg.norm(points - place, axis=1)
        best, least = np.where((apart < least)[:, None], place, best), np.minimum(apart, least)
    return np.where(inside[:, None], foot, best)


def _pairs(points: FloatArray, corners: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
    """Points and triangles whose boxes come within `reach` [mm]."""
    low, high = corners.min(axis=1) - reach, corners.max(axis=1) + reach
    near = ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2)
    return np.nonzero(near)


def contact_points(
    model: ContactModel, vertices: FloatArray, pose: ProbePose, frame: FrictionFrame,
) -> ContactPoints:
    """Forces at all contact points.

    Args:
        model: probe, skin and laws.
        vertices: positions of the skin's vertices [mm], shape (v, 3).
        pose: of the probe.
        frame: what friction refers to in this step.
    """
    config, n = model.config, model.n_points
    samples, corners = pose.place(model.probe.samples), pose.place(model.probe.vertices)
    push, size, moment = np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3))
    skin, probe = vertices[model.skin.surface.triangles], corners[model.probe.surface.triangles]
    for points, faces, first in ((samples, skin, 0), (vertices, probe, len(samples))):
        point, face = _pairs(points, faces, config.gap)
        place = nearest_places(points[point], faces[face])
        from_probe = points[point] if first == 0 else place
        apart = (place - points[point]) * (1.0 if first == 0 else -1.0)  # from probe to skin
        distance = np.linalg.norm(apart, axis=1)
        violation = np.maximum(config.gap - distance, 0.0)
        force = np.where(
            violation < config.smoothing, config.stiffness * violation**2 / (2.0 * config.smoothing),
            config.stiffness * (violation - 0.5 * config.smoothing),
        )
        vector = (force / np.maximum(distance, 1e-12))[:, None] * apart
        np.add.at(push, first + point, vector)
        np.add.at(size, first + point, force)
        np.add.at(moment, first + point, np.cross(from_probe - pose.translation, vector))
    place = np.einsum("pc,pck->pk", frame.weights, vertices[frame.vertices])
    slip = frame.slip - frame.start + place - pose.place(frame.local)
    slip -= np.einsum("pk,pk->p", slip, frame.normal)[:, None] * frame.normal
    length = np.linalg.norm(slip, axis=1)
    limit = np.minimum(config.stiffness * length, config.friction * size)
    friction = -np.where(frame.anchored, limit / np.maximum(length, 1e-300), 0.0)[:, None] * slip
    return ContactPoints(push, size, friction, moment, np.cross(place - pose.translation, friction))
