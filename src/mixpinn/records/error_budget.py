"""ErrorBudget: how far answers about one patient are from the converged solution, and what decides them besides."""

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mixpinn.base.validated import load_record, save_record

BUDGET_FILE = "budget.json"
_REMAKE = "run 'mixpinn assess' again"


class BudgetKind(StrEnum):
    """What an entry is about."""

    ERROR = "error"
    """How far the answer is from the converged solution of its own equations."""
    SENSITIVITY = "sensitivity"
    """By how much the answer changes with what is not known of the patient."""


@dataclass(frozen=True)
class BudgetEntry:
    """One source of error, or one quantity that is not known; K rigid parts.

    Attributes:
        source: what it is, in words.
        kind: error or sensitivity.
        varied: what was changed, from what to what.
        force: largest change of the force on the probe over the poses [N]; None where it was not evaluated.
        force_share: the same relative to the force, with its sign where all poses agree in it.
        motions: largest change of the translation of each rigid part [mm], by name.
        motion_share: largest change of a translation over the poses, relative to the largest translation of its pose.
        field: largest mean change of the displacement of the vertices [mm]; None where meshes differ.
        solved: poses that were compared.
        sentence: what it means, for a reader who presses backs and not equations.
        note: what a reader must know beside the figures.
    """

    source: str
    kind: BudgetKind
    varied: str
    force: float | None
    force_share: float | None
    motions: dict[str, float]
    motion_share: float
    field: float | None
    solved: int
    sentence: str
    note: str = ""

    @property
    def motion(self) -> float:
        """Of the part that changes most [mm]."""
        return max(self.motions.values(), default=0.0)


@dataclass(frozen=True)
class ErrorBudget:
    """The budget of one bundle.

    Attributes:
        bundle: name of the model.
        discretisation: elements and mesh of its solver.
        depth: of the presses beyond first touch [mm].
        tips: of the probe at the end of each press, world [mm].
        force: mean force on the probe over the presses [N].
        motions: mean translation of each rigid part over the presses [mm], by name.
        entries: errors, then sensitivities.
        total_force: root of the sum of the squares of the errors' forces [N].
        total_motions: the same of the motions of each part [mm], by name.
        sentence: the whole in one sentence.
        complete: whether every solve that was planned was done and converged.
    """

    bundle: str
    discretisation: str
    depth: float
    tips: tuple[tuple[float, float, float], ...]
    force: float
    motions: dict[str, float]
    entries: tuple[BudgetEntry, ...]
    total_force: float
    total_motions: dict[str, float]
    sentence: str
    complete: bool

    @property
    def total(self) -> "TotalError":
        """What it says of any answer of the bundle."""
        errors = [entry for entry in self.entries if entry.kind is BudgetKind.ERROR]
        return TotalError(
            math.sqrt(sum((entry.force_share or 0.0) ** 2 for entry in errors)),
            math.sqrt(sum(entry.motion_share**2 for entry in errors)), self.depth, len(self.tips),
        )

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    @staticmethod
    def load(path: Path | str) -> "ErrorBudget":
        """Read what `save` wrote.

        Raises:
            InputError: absent or damaged.
        """
        return load_record(ErrorBudget, path, remake=_REMAKE)


@dataclass(frozen=True)
class TotalError:
    """How far answers of a bundle may be from the converged solution, relative to what they say.

    The budget knows it at its presses; other answers are taken to be off in the same proportion. Each share is the
    root of the sum of the squares of the errors' shares, of each the largest over the presses.

    Attributes:
        force: of the force on the probe, relative.
        motion: of the motions of rigid parts, relative to that of the part that moves most.
        depth: of the budget's presses [mm].
        presses: how many these are.
    """

    force: float
    motion: float
    depth: float
    presses: int

    def describe(self, force: float | None, motion: float | None) -> str:
        """One line about an answer.

        Args:
            force: size of its force on the probe [N]; None where the answer has none.
            motion: its largest motion of a rigid part [mm]; None without rigid parts.
        """
        parts = []
        if force is not None:
            parts.append(f"the force may be off by about {_two(self.force * force)} N ({100.0 * self.force:.0f} %)")
        if motion is not None:
            parts.append(f"the motions by {_two(self.motion * motion)} mm ({100.0 * self.motion:.0f} %)")
        told = ", ".join(parts) or "not known of this answer"
        return f"Against the converged solution: {told}; error budget of {self.presses} presses {self.depth:g} mm deep"


def _two(value: float) -> str:
    """Two significant digits, without a power of ten."""
    return f"{float(f'{value:.2g}'):g}"
