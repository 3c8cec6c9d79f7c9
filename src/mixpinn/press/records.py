"""Records of contact from the pose: settings, probe, what friction remembers, and the outcome."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PATH_STEP

if TYPE_CHECKING:
    from mixpinn.press.probe_field import ProbeField


@dataclass(frozen=True)
class PoseContactConfig:
    """How contact of a pose is solved.

    Attributes:
        gap: distance at which contact acts [mm].
        friction: Coulomb's coefficient μ.
        stiffness: of contact, normal and tangential, for each area of skin [N/mm/mm²].
        smoothing: violation over which the contact stiffness sets in [mm].
        spacing: largest edge of the parts of a face of the skin that each have a contact point, or, where faces have
            six nodes, three [mm].
        margin: skin within this distance of the probe's shadow takes part [mm].
        reach: a probe that is farther than this from first touch touches nothing [mm].
        deepest: what of the probe lies this far above its tip or farther is not met [mm].
        step: length of the steps of a path [mm]. A bundle records the one that it was fitted with.
        most_steps: of a path that begins at a history; a longer one has longer steps.
        arm: distance from the tip at which a turn counts as a way [mm].
        tolerance: of the forces, relative.
        on_the_way: tolerance of all steps of a path but the last, relative.
        max_iterations: of one solve.

    Gap and friction are those of the simulations. The other defaults were chosen by hand: for speed, a softer and
    wider penalty than the solver's (500 N/mm over 0.02 mm) and samples twice as far apart. By how much contact gives
    way, F / k a contact point, is left to the regression on simulations. No measurement of single values is kept.
    """

    gap: float = 2.0
    friction: float = 1.0
    stiffness: float = 4.0
    smoothing: float = 0.1
    spacing: float = 4.0
    margin: float = 6.0
    reach: float = 2.0
    deepest: float = 35.0
    step: float = PATH_STEP
    most_steps: int = 60
    arm: float = 20.0
    tolerance: float = 1e-5
    on_the_way: float = 5e-3
    max_iterations: int = 40

    @staticmethod
    def of_order(order: int, *, gap: float, friction: float) -> "PoseContactConfig":
        """The settings for cells of an order, 1 or 2.

        Faces of six nodes have three points on each part already, so that parts three times as long sample them well.
        These faces are larger than a probe is wide, and stiffer at its edge than skin: points that give way by about a
        millimetre stand for what the skin gives way between nodes, and spare most iterations. All was chosen on poses
        that were not fitted on, of two patients onboarded by default; with half the stiffness single deep presses did
        not converge.
        """
        if order == 1:
            return PoseContactConfig(gap=gap, friction=friction)
        return PoseContactConfig(
            gap=gap, friction=friction, spacing=12.0, stiffness=0.2, smoothing=1.2, on_the_way=2e-2,
        )


@dataclass(frozen=True, eq=False)
class ContactHistory:
    """State to carry from one pose to the next; k probes, c candidate nodes, h contacts.

    Attributes:
        rotations, translations: of the probes, shapes (k, 3, 3) and (k, 3) [mm].
        force: gradient of contact on all candidate nodes [N], shape (c, 3).
        shift: where these would be without contact, relative to rest [mm], shape (c, 3).
        probe, point: of each contact the probe and the point of the skin, shape (h,).
        slip: of each its elastic slip in the probe's frame [mm], shape (h, 3).
        lead: of each the violation of the gap that counts beside the present one [mm], shape (h,).
        dragged: how far each probe was moved across since it gripped the skin, where forces were learned [mm], (k, 3).
    """

    rotations: FloatArray
    translations: FloatArray
    force: FloatArray
    shift: FloatArray
    probe: IntArray
    point: IntArray
    slip: FloatArray
    lead: FloatArray
    dragged: FloatArray | None = None


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
        depths: of each probe beyond first touch along its axis [mm], shape (k,); −inf where no skin is in its way.
        history: to hand to the next call where friction is to remember.
        converged: whether every solve met its tolerance.
        tries: steps of Newton's method in all; one that was shortened counts as often as it was tried.
    """

    nodes: IntArray
    displacement: FloatArray
    forces: FloatArray
    shares: FloatArray
    wrench: FloatArray
    sliding: FloatArray
    depths: FloatArray
    history: ContactHistory
    converged: bool
    tries: int


@dataclass(frozen=True, eq=False)
class PlacedFields:
    """Distances from probes at their poses; rotations (k, 3, 3), translations (k, 3) [mm]."""

    fields: "tuple[ProbeField, ...]"
    rotations: FloatArray
    translations: FloatArray

    @property
    def joined(self) -> "_Joined":
        """The distances one after another, as the kernels take them, and the bounds of each probe."""
        return _joined(self.fields)


_Joined = tuple[Float32Array, IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray]


@lru_cache(maxsize=64)
def _joined(fields: "tuple[ProbeField, ...]") -> _Joined:
    flat = [field.coefficients.ravel() for field in fields]
    return (
        flat[0] if len(flat) == 1 else np.concatenate(flat), np.cumsum([0, *(len(part) for part in flat)]),
        np.array([field.coefficients.shape for field in fields]), np.array([field.origin for field in fields]),
        np.array([field.spacing for field in fields]),
        np.array([field.probe.points.min(axis=0) for field in fields]),
        np.array([field.probe.points.max(axis=0) for field in fields]),
    )


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
