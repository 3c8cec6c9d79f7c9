"""What onboarding reached when: a page of a few lines and a plot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mixpinn.base.files import atomic_path
from mixpinn.evaluation.budget_page import budget_tables
from mixpinn.records.error_budget import ErrorBudget


def rounds_report(
    rounds: Sequence[Mapping[str, Any]], *, mesh_nodes: int, body: Mapping[str, str] | None = None,
    budget: ErrorBudget | None = None, minutes: float | None = None,
) -> str:
    """Markdown: when the predictor became usable, and its error on each round's poses before it learned from them.

    Args:
        rounds: what was reached when.
        mesh_nodes: number of nodes.
        body: what else the body is made of (parts, joints, supports), by what it is.
        budget: how far answers are from the converged solution.
        minutes: that all took, pauses not counted.
    """
    prior = next((entry for entry in rounds if entry["stage"] == "prior"), None)
    lines = [f"# A predictor for one anatomy\n\nMesh of {mesh_nodes:,} nodes.\n"]
    lines += [f"{what}: {text}.\n" for what, text in (body or {}).items()]
    if prior is not None:
        lines.append(
            f"The elastic prior could be used {prior['minutes']:.1f} minutes after the start, "
            f"{prior['after_labels']:.0f} s after the label maps were read.\n"
        )
    learned = [entry for entry in rounds if "model_mee" in entry]
    if learned:
        lines += [
            "Each round's poses are predicted before anything is learned from them. Mean errors in mm, against the "
            "simulations.\n",
            "| After | New poses | Samples | No motion | Elastic prior | Predictor so far | Its correction | Minutes |",
            "| --- | ---: | ---: | ---: | ---: | ---: | --- | ---: |",
            *(
                f"| {entry['stage']} | {entry['poses']} | {entry['samples']} | {entry['no_motion']:.3f} | "
                f"{entry['prior_mee']:.4f} | {entry['model_mee']:.4f} | {entry.get('correction', '')} | "
                f"{entry['minutes']:.1f} |" for entry in learned
            ),
            "",
            "The correction is what the predictor adds to the elastic prior: nothing, a multiple of the Newton step, "
            "or a regression besides, whichever cross-validation over positions found best.\n",
        ]
    if budget is not None:
        lines += ["## Error against the converged solution\n", f"{budget.sentence}\n"]
        lines += [
            f"{len(budget.tips)} presses, {budget.depth:g} mm beyond first touch, solved again with one thing changed; "
            "the largest change over them. `mixpinn assess` finds more: facets, what is not known of the patient.\n",
        ]
        lines += [table.markdown() for table in budget_tables(budget)]
    if minutes is not None:
        lines.append(f"All of it took {minutes:.1f} minutes.\n")
    return "\n".join(lines)


def draw_rounds(rounds: Sequence[Mapping[str, Any]], path: Path | str) -> None:
    """Plot the error on new poses against the wall time; nothing where no round was simulated."""
    learned = [entry for entry in rounds if "model_mee" in entry]
    if not learned:
        return
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    minutes = [entry["minutes"] for entry in learned]
    axes.plot(minutes, [entry["prior_mee"] for entry in learned], "o--", color="grey", label="elastic prior")
    axes.plot(minutes, [entry["model_mee"] for entry in learned], "o-", color="C0", label="predictor so far")
    axes.set(xlabel="wall time [min]", ylabel="mean error on new poses [mm]", ylim=(0.0, None))
    axes.legend(frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")
