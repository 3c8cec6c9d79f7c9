"""What a live session takes and gives: where each probe is, and an answer that names the poses it belongs to."""

from dataclasses import dataclass
from enum import StrEnum

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.records.answer import Answer


class Friction(StrEnum):
    """What friction knows of the way to a pose."""

    REMEMBERED = "remembered"
    """The probe came from its last pose: skin that was gripped there is dragged along until it slides."""
    STRAIGHT = "straight"
    """The probe came straight along its axis: an answer depends on nothing asked before."""


@dataclass(frozen=True, eq=False)
class LiveProbe:
    """One probe and the newest pose that was asked for.

    Attributes:
        index: of the probe in its session.
        pose_id: number that whoever moved it gave the pose.
        pose: where it is.
        asked: when the pose came [s], by `time.perf_counter`.
        depth: beyond first touch of the resting skin along its axis [mm]; −inf where no skin is in its way.
    """

    index: int
    pose_id: int
    pose: ProbePose
    asked: float
    depth: float = 0.0


@dataclass(frozen=True, eq=False)
class LiveAnswer:
    """How the body stands under all probes of a session.

    Attributes:
        sequence: 1, 2, … of this session.
        probes: where each probe is, in ascending order of their indices; rows of `Answer.force` go by them.
        answer: the whole answer; `force` and `moment` are (k, 3) of the k probes.
        matrices: of each rigid part from rest to where it is, world [mm], shape (K, 4, 4).
        time: since the session began [s].
        seconds: how long the prediction took [s].
        remembered: whether friction remembered the way.
        replayed: whether it comes from a recording.
    """

    sequence: int
    probes: tuple[LiveProbe, ...]
    answer: Answer
    matrices: FloatArray
    time: float
    seconds: float
    remembered: bool = False
    replayed: bool = False

    @property
    def newest(self) -> LiveProbe | None:
        """The probe that was moved last; None where there are no probes."""
        return max(self.probes, key=lambda probe: probe.asked, default=None)

    @property
    def pose_id(self) -> int:
        """Number of the newest pose in it; 0 without a probe."""
        newest = self.newest
        return newest.pose_id if newest is not None else 0


@dataclass(frozen=True, eq=False)
class Refusal:
    """A pose that no answer can be given for.

    Attributes:
        pose_id: number of the newest pose among those asked for.
        error: what is wrong and how to mend it.
    """

    pose_id: int
    error: InputError
