"""Inspection of a store: steps that did not converge, and det F of the others at quadrature points and vertices."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.progress import track
from mixpinn.base.validated import save_record
from mixpinn.dataset.status import PoseState
from mixpinn.dataset.store import SimulationStore
from mixpinn.fem.elements.jacobians import smallest_jacobians
from mixpinn.records import Simulation, TissueMesh
from mixpinn.records.answer import discretisation_of

QUADRATURE, VERTICES = "quadrature points", "vertices"
_MOST = 40
"""Rows that a table shows; the file has them all."""


@dataclass(frozen=True)
class Step:
    """A step of a pose.

    Attributes:
        pose: its name.
        step: index of the step.
        depth: of the probe's path [mm].
    """

    pose: str
    step: int
    depth: float


@dataclass(frozen=True)
class NonPositive:
    """A cell with det F ≤ 0 in a converged step.

    Attributes:
        at: the step.
        cell: index of the cell.
        place: quadrature points or vertices; a linear cell has one det F, which counts as the former.
        determinant: the smallest det F there.
        residual: of the step's equilibrium, relative to the contact force: the published energies allow det F ≤ 0, so
            that a small one says that this is an equilibrium of the energy and no failure of the solver.
    """

    at: Step
    cell: int
    place: str
    determinant: float
    residual: float


@dataclass(frozen=True)
class StoreInspection:
    """What is to be known of the steps of a store.

    Attributes:
        discretisation: elements and mesh.
        poses: poses of the store.
        done: finished ones, which were looked at.
        steps: their steps.
        unconverged: those that did not converge.
        smallest: the smallest det F by place, and where; None where no step converged.
        non_positive: every cell with det F ≤ 0, by pose, step and cell.
    """

    discretisation: str
    poses: int
    done: int
    steps: int
    unconverged: tuple[Step, ...]
    smallest: dict[str, NonPositive | None]
    non_positive: tuple[NonPositive, ...]

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    def markdown(self) -> str:
        """Totals, and a row for each step and cell that needs a word."""
        rows = {
            "Simulated on": self.discretisation, "Poses": f"{self.done} of {self.poses} done", "Steps": str(self.steps),
            "Steps that did not converge": str(len(self.unconverged)),
        }
        for place, worst in self.smallest.items():
            count = sum(entry.place == place for entry in self.non_positive)
            rows[f"Smallest det F at {place}"] = "unknown" if worst is None else (
                f"{worst.determinant:.4g} ({worst.at.pose}, {worst.at.depth:g} mm, cell {worst.cell}); {count} ≤ 0"
            )
        lines = ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows.items()), ""]
        if self.unconverged:
            lines += ["| Did not converge | Step | Depth [mm] |", "| --- | ---: | ---: |"]
            lines += [f"| {step.pose} | {step.step} | {step.depth:g} |" for step in self.unconverged[:_MOST]]
            lines += [*_more(len(self.unconverged)), ""]
        if self.non_positive:
            lines += [
                "| det F ≤ 0 | Step | Depth [mm] | Cell | At | det F | Residual |",
                "| --- | ---: | ---: | ---: | --- | ---: | ---: |",
            ]
            lines += [
                f"| {entry.at.pose} | {entry.at.step} | {entry.at.depth:g} | {entry.cell} | {entry.place} | "
                f"{entry.determinant:.3g} | {entry.residual:.1e} |" for entry in self.non_positive[:_MOST]
            ]
            lines += [*_more(len(self.non_positive)), ""]
        return "\n".join(lines)


def inspect_store(store: SimulationStore) -> StoreInspection:
    """Look at every step of every finished pose.

    Args:
        store: the simulations.

    Raises:
        InputError: a damaged store.
    """
    mesh = store.mesh()
    done = {status.name for status in store.statuses() if status.state is PoseState.DONE}
    steps, unconverged, found = 0, [], []
    smallest: dict[str, NonPositive | None] = dict.fromkeys((QUADRATURE, VERTICES) if mesh.order > 1 else (QUADRATURE,))
    for pose in track([pose for pose in store.poses if pose.name in done], "inspect"):
        simulation = store.load(pose)
        steps += simulation.n_steps
        unconverged += [
            Step(pose.name, int(step), float(simulation.path.depths[step]))
            for step in np.flatnonzero(~simulation.converged)
        ]
        for entry in _extremes(mesh, simulation, pose.name):
            worst = smallest[entry.place]
            if worst is None or entry.determinant < worst.determinant:
                smallest[entry.place] = entry
            if entry.determinant <= 0.0:
                found.append(entry)
    return StoreInspection(
        discretisation_of(mesh), len(store.poses), len(done), steps, tuple(unconverged), smallest, tuple(found),
    )


def _extremes(mesh: TissueMesh, simulation: Simulation, pose: str) -> Iterator[NonPositive]:
    """Of each converged step and place the cells with det F ≤ 0; without any the cell with the smallest."""
    places = {QUADRATURE: None, **({VERTICES: np.eye(4)} if mesh.order > 1 else {})}
    for step in np.flatnonzero(simulation.converged):
        at = Step(pose, int(step), float(simulation.path.depths[step]))
        for place, points in places.items():
            ratios = smallest_jacobians(mesh, simulation.displacement[step], places=points)
            cells = np.flatnonzero(ratios <= 0.0)
            for cell in cells if len(cells) else [int(ratios.argmin())]:
                yield NonPositive(at, int(cell), place, float(ratios[cell]), float(simulation.residual[step]))


def _more(count: int) -> list[str]:
    return [f"\n… and {count - _MOST} more"] if count > _MOST else []
