"""Records of contact from the pose: settings, probe, what friction remembers, and the outcome."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import Probe


@dataclass(frozen=True)
class PoseContactConfig:
    """How contact of a pose is solved.

    Attributes:
        gap: distance at which contact acts [mm].
        friction: Coulomb's coefficient μ.
        stiffness: of one contact, normal and tangential [N/mm].
        smoothing: violation over which the contact stiffness sets in [mm].
        spacing: largest distance between neighbouring contact points on the probe [mm].
        margin: skin within this distance of the probe's shadow takes part [mm].
        reach: how far from touching a pair may be and still be followed [mm].
        substeps: parts of the way down.
        rounds: solves for each of them, each with pairs and normals of the one before.
        tolerance: of the forces, relative.
        max_iterations: of one solve.

    Gap and friction are those of the simulations. The other defaults were chosen by hand: for speed, a softer and
    wider penalty than the solver's (500 N/mm over 0.02 mm) and samples twice as far apart. By how much contact gives
    way, F / k a contact point, is left to the regression on simulations. No measurement of single values is kept.
    """

    gap: float = 2.0
    friction: float = 1.0
    stiffness: float = 30.0
    smoothing: float = 0.1
    spacing: float = 4.0
    margin: float = 6.0
    reach: float = 6.0
    substeps: int = 4
    rounds: int = 1
    tolerance: float = 1e-4
    max_iterations: int = 30


@dataclass(frozen=True, eq=False)
class ProbeGeometry:
    """A probe as contact sees it, in its own frame, tip at the origin and pointing to −y.

    Attributes:
        vertices: of the surface [mm], shape (p, 3).
        triangles: shape (t, 3).
        samples: points on the surface [mm], shape (q, 3).
    """

    vertices: FloatArray
    triangles: IntArray
    samples: FloatArray

    @staticmethod
    def of_probe(probe: Probe, *, spacing: float = 4.0) -> "ProbeGeometry":
        """Sample the surface of `probe` at most `spacing` [mm] apart."""
        from mixpinn.geometry.probe_surface import ProbeSurface

        surface = ProbeSurface.of_probe(probe, spacing=spacing)
        return ProbeGeometry(
            np.ascontiguousarray(surface.vertices), np.ascontiguousarray(surface.surface.triangles),
            np.ascontiguousarray(surface.samples),
        )


@dataclass(frozen=True, eq=False)
class Grip:
    """What friction of one probe remembers: h places of the skin that were under force.

    Attributes:
        point: probe sample, or −1 − mesh node where a node touched the probe's face, shape (h,).
        nodes: mesh nodes of the place of the skin, shape (h, 3).
        weights: their weights, shape (h, 3).
        anchor: in the probe's frame, where the place would carry no friction [mm], shape (h, 3).
    """

    point: IntArray
    nodes: IntArray
    weights: FloatArray
    anchor: FloatArray


NO_GRIP = Grip(np.empty(0, dtype=np.int64), np.empty((0, 3), dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)))


@dataclass(frozen=True, eq=False)
class ContactHistory:
    """State to carry from one pose to the next.

    Attributes:
        grips: one a probe.
        force: gradient of contact on all candidate nodes [N], shape (c, 3).
    """

    grips: tuple[Grip, ...]
    force: FloatArray


@dataclass(frozen=True, eq=False)
class ContactPrediction:
    """Contact of one pose on the linear body; l loaded nodes, k probes.

    Attributes:
        nodes: mesh nodes that carry force, ascending, shape (l,).
        displacement: of each [mm], shape (l, 3).
        forces: of the probes on each [N], shape (l, 3).
        shares: of each probe in them [N], shape (k, l, 3).
        wrench: force [N] and moment about the tip [N mm] of the tissue on each probe, shape (k, 6).
        sliding: share of the normal force of each probe that slides, shape (k,).
        pairs: what friction of this solve refers to.
        history: to hand to the next call where friction is to remember.
        converged: whether every solve met its tolerance.
        iterations: of Newton's method in all.
    """

    nodes: IntArray
    displacement: FloatArray
    forces: FloatArray
    shares: FloatArray
    wrench: FloatArray
    sliding: FloatArray
    pairs: tuple[Grip, ...]
    history: ContactHistory
    converged: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class PlacedProbe:
    """A probe at a pose; `axis` is where it presses to."""

    geometry: ProbeGeometry
    rotation: FloatArray
    translation: FloatArray
    axis: FloatArray

    def placed(self) -> tuple[FloatArray, FloatArray]:
        """World positions of samples and vertices [mm]."""
        turn = self.rotation.T
        return self.geometry.samples @ turn + self.translation, self.geometry.vertices @ turn + self.translation


def check_poses(n_probes: int, rotations: AnyArray, translations: AnyArray) -> tuple[FloatArray, FloatArray]:
    """Poses of `n_probes` probes as float64 arrays (k, 3, 3) and (k, 3).

    Raises:
        InputError: another number of poses, a value that is not finite, or a matrix that is no rotation.
    """
    turns = np.asarray(rotations, dtype=np.float64)
    places = np.asarray(translations, dtype=np.float64)
    if turns.shape != (n_probes, 3, 3) or places.shape != (n_probes, 3) or not n_probes:
        raise InputError(
            "poses", expected=f"rotations (k, 3, 3) and translations (k, 3) of k = {n_probes or 'one or more'} probes",
            got=f"shapes {turns.shape} and {places.shape}", fix="give one pose for each probe",
        )
    if not (np.isfinite(turns).all() and np.isfinite(places).all()):
        raise InputError("poses", expected="finite numbers", got="nan or inf", fix="check the tracking")
    rigid = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() < 1e-3 and (np.linalg.det(turns) > 0.0).all()
    if not rigid:
        raise InputError("poses", expected="rotation matrices", got="another matrix", fix="orthonormalise them")
    return turns, places
