"""Status: what became of one pose, and what a reader of the store must know of it without opening it."""

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.files import hash_arrays, is_foreign
from mixpinn.base.validated import load_record, save_record
from mixpinn.records import Simulation


class PoseState(StrEnum):
    """What became of a pose."""

    DONE = "done"
    FAILED = "failed"
    MISSING = "missing"


@dataclass(frozen=True)
class PoseStatus:
    """One pose's entry in a store.

    Attributes:
        name: of the pose.
        state: done, failed (no result), or missing (not begun, or damaged since).
        reason: why it failed or is missing.
        attempts: how often it was begun.
        steps: steps recorded.
        contact_steps: steps that are samples (converged, with load).
        failed_steps: indices of the steps that did not converge.
        iterations: Newton iterations of all steps.
        min_jacobian: smallest det F of all cells and converged steps, None where unknown.
        worst_residual: largest relative residual of the converged steps, None where unknown.
        peak_penetration: largest violation of the contact gap over the converged steps [mm], None where unknown.
        peak_energy: largest elastic energy over the converged steps [N mm], None where unknown.
        seconds: wall time of all steps [s].
        content_hash: hash of the arrays as they were saved.
        files: size of each file of the saved group [byte], by path.
    """

    name: str
    state: PoseState
    reason: str = ""
    attempts: int = 0
    steps: int = 0
    contact_steps: int = 0
    failed_steps: tuple[int, ...] = ()
    iterations: int = 0
    min_jacobian: float | None = None
    worst_residual: float | None = None
    peak_penetration: float | None = None
    peak_energy: float | None = None
    seconds: float = 0.0
    content_hash: str = ""
    files: dict[str, int] | None = None

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    @staticmethod
    def load(path: Path | str) -> "PoseStatus":
        """Read what `save` wrote.

        Raises:
            InputError: absent or damaged.
        """
        return load_record(PoseStatus, path, remake="delete it and simulate the pose again")


def content_hash(simulation: Simulation) -> str:
    """Identity of all arrays of a simulation."""
    arrays = simulation.arrays()
    return hash_arrays(*(arrays[name] for name in sorted(arrays)))


def folder_sizes(folder: Path) -> dict[str, int]:
    """Size of each file below `folder` [byte], by relative path."""
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(folder.rglob("*"))
        if path.is_file() and not is_foreign(path.name)
    }


def status_of(name: str, simulation: Simulation, *, folder: Path, attempts: int) -> PoseStatus:
    """Status of a simulation that was saved at `folder`."""
    good = simulation.converged.astype(bool)
    return PoseStatus(
        name, PoseState.DONE, attempts=attempts, steps=simulation.n_steps,
        contact_steps=len(simulation.sample_steps()),
        failed_steps=tuple(int(step) for step in np.flatnonzero(~good)),
        iterations=int(simulation.iterations.sum()),
        min_jacobian=_extreme(simulation.min_jacobian[good], min),
        worst_residual=_extreme(simulation.residual[good], max),
        peak_penetration=_extreme(simulation.penetration[good], max),
        peak_energy=_extreme(simulation.energy[good], max),
        seconds=float(np.nansum(simulation.seconds)),
        content_hash=content_hash(simulation), files=folder_sizes(folder),
    )


def _extreme(values: Any, choose: Any) -> float | None:
    known = [float(value) for value in np.ravel(values) if math.isfinite(value)]
    return choose(known) if known else None
