"""Summary: the totals of a store of simulations."""

from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset.inverted_cells import InvertedCell, list_inverted
from mixpinn.dataset.status import PoseState
from mixpinn.dataset.store import SimulationStore

SUMMARY = "summary.json"


@dataclass(frozen=True)
class GenerationSummary:
    """Totals over all poses of a store.

    Attributes:
        poses: number of poses that belong to the store.
        done, failed, missing: how many are in each state.
        steps: steps recorded.
        contact_steps: steps that are samples.
        failed_steps: steps that did not converge.
        iterations: Newton iterations.
        min_jacobian: smallest det F, and the pose where it occurs.
        worst_residual: largest relative residual of a converged step, and its pose.
        peak_penetration: largest violation of the contact gap [mm], and its pose.
        peak_energy: largest elastic energy [N mm], and its pose.
        solve_seconds: wall time of all steps, summed over workers [s].
        wall_seconds: wall time of the generation, resumed runs added up [s].
        workers: worker processes of the last run.
        reasons: why poses failed, with the number of poses.
        inverted: cells with det F ≤ 0, by pose and cell; None where they were not looked for.
    """

    poses: int
    done: int
    failed: int
    missing: int
    steps: int
    contact_steps: int
    failed_steps: int
    iterations: int
    min_jacobian: tuple[float, str] | None
    worst_residual: tuple[float, str] | None
    peak_penetration: tuple[float, str] | None
    peak_energy: tuple[float, str] | None
    solve_seconds: float
    wall_seconds: float
    workers: int
    reasons: dict[str, int]
    inverted: tuple[InvertedCell, ...] | None = None

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    @staticmethod
    def load(path: Path | str) -> "GenerationSummary":
        """Read what `save` wrote.

        Raises:
            InputError: absent or damaged.
        """
        return load_record(GenerationSummary, path, remake="delete it: the next 'mixpinn simulate' writes it again")

    def totals(self) -> dict[str, Any]:
        """Plain values without the list of inverted cells, which may be long."""
        values = asdict(replace(self, inverted=None))
        del values["inverted"]
        return values

    def markdown(self) -> str:
        """A table of two columns."""
        def at(entry: tuple[float, str] | None, unit: str = "") -> str:
            return "unknown" if entry is None else f"{entry[0]:.3g}{unit} ({entry[1]})"

        rows = {
            "Poses done": f"{self.done} of {self.poses}", "Poses failed": str(self.failed),
            "Poses missing": str(self.missing), "Steps": str(self.steps), "Samples": str(self.contact_steps),
            "Steps that did not converge": str(self.failed_steps), "Newton iterations": str(self.iterations),
            "Smallest det F": at(self.min_jacobian), "Inverted cells": self._inverted(),
            "Worst residual": at(self.worst_residual),
            "Peak penetration of the gap": at(self.peak_penetration, " mm"),
            "Peak elastic energy": at(self.peak_energy, " N mm"),
            "Time of all steps": f"{self.solve_seconds:.1f} s",
            "Wall time": f"{self.wall_seconds:.1f} s with {self.workers} workers",
        }
        return "\n".join(["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows.items())]) + "\n"

    def _inverted(self) -> str:
        if self.inverted is None:
            return "not looked for"
        poses = len({entry.pose for entry in self.inverted})
        return f"{len({entry.cell for entry in self.inverted})} in {poses} poses" if poses else "none"


def summarise(
    store: SimulationStore, *, wall_seconds: float = 0.0, workers: int = 0, cells: bool = True,
) -> GenerationSummary:
    """Add up the statuses of a store.

    Args:
        store: the simulations.
        wall_seconds: of their generation [s].
        workers: that generated them.
        cells: whether to look for inverted cells; what an earlier call found is not sought again.
    """
    statuses = store.statuses()
    states = Counter(status.state for status in statuses)

    def extreme(field: str, sign: float) -> tuple[float, str] | None:
        known = [(getattr(status, field), status.name) for status in statuses if getattr(status, field) is not None]
        return max(known, key=lambda entry: sign * entry[0]) if known else None

    return GenerationSummary(
        poses=len(statuses), done=states[PoseState.DONE], failed=states[PoseState.FAILED],
        missing=states[PoseState.MISSING], steps=sum(status.steps for status in statuses),
        contact_steps=sum(status.contact_steps for status in statuses),
        failed_steps=sum(len(status.failed_steps) for status in statuses),
        iterations=sum(status.iterations for status in statuses),
        min_jacobian=extreme("min_jacobian", -1.0), worst_residual=extreme("worst_residual", 1.0),
        peak_penetration=extreme("peak_penetration", 1.0), peak_energy=extreme("peak_energy", 1.0),
        solve_seconds=sum(status.seconds for status in statuses), wall_seconds=wall_seconds, workers=workers,
        reasons=dict(Counter(status.reason for status in statuses if status.state is PoseState.FAILED)),
        inverted=list_inverted(store, statuses) if cells else None,
    )
