"""The paper's whole protocol, from the summary that the simulation stored."""

from pathlib import Path

from benchmarks.validation.result import Result, Section
from mixpinn.dataset import GenerationSummary

POSES = 528


def run(summary: Path | None) -> Section:
    """The rows of the long run.

    Args:
        summary: ``summary.json`` of ``mixpinn simulate --protocol paper``, or None where there is no run.
    """
    title = "The paper's protocol"
    if summary is None or not summary.is_file():
        return Section(title, "Not run: pass the summary of a finished simulation with `--summary`.", (
            Result("paper's protocol, poses done", float("nan"), f"= {POSES}", False),
        ))
    totals = GenerationSummary.load(summary)
    penetration = totals.peak_penetration[0] if totals.peak_penetration else float("nan")
    residual = totals.worst_residual[0] if totals.worst_residual else float("nan")
    results = [
        Result("paper's protocol, poses done", float(totals.done), f"= {POSES}", totals.done == POSES),
        Result("paper's protocol, steps that did not converge", float(totals.failed_steps), "= 0",
               totals.failed_steps == 0),
        Result.at_most("paper's protocol, penetration of the gap [mm]", penetration, 0.1),
        Result.at_most("paper's protocol, worst relative residual", residual, 1e-6),
        Result.at_most("paper's protocol, wall time [min]", totals.wall_seconds / 60.0, 60.0),
    ]
    return Section(title, totals.markdown(), tuple(results))
