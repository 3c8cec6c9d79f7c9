"""Plots of the paper's experiments: rows compared, hold-outs, and the need for data."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from mixpinn.evaluation.plots import COLOURS, MARKERS, PLOT_STYLE, new_figure
from mixpinn.studies.ablation_tables import ROW_TITLES, AblationRun, by_row, over_seeds, switches


def ablation_bars(runs: Sequence[AblationRun], test_set: str) -> Figure:
    """MEE, rigid MEE and REE of every row; a whisker is the standard deviation over seeds, a dot one seed."""
    members = by_row(runs)
    figure, _ = new_figure(height=1.6 + 0.34 * len(members))
    figure.clear()
    with rc_context(PLOT_STYLE):
        panels = figure.subplots(1, 3, sharey=True)
        places = np.arange(len(members))[::-1]
        for index, (panel, (metric, title)) in enumerate(zip(
            panels, {"mee": "MEE [mm]", "rigid_mee": "Rigid MEE [mm]", "ree": "REE [mm]"}.items(), strict=True,
        )):
            for place, runs_of_row in zip(places, members.values(), strict=True):
                found = over_seeds(runs_of_row, test_set, metric)
                if found is None:
                    continue
                trained = runs_of_row[0].seed is not None
                panel.barh(
                    place, found[0], 0.72, color=COLOURS[index] if trained else "#999999", alpha=0.85,
                    xerr=found[1], error_kw={"linewidth": 1.2, "ecolor": "#222222"},
                )
                if found[1] is not None:
                    seeds = [run.mean(test_set, metric) or 0.0 for run in runs_of_row]
                    panel.plot(seeds, [place] * len(seeds), ".", color="#222222", markersize=4)
            panel.grid(False, axis="y")
            panel.set(xlabel=title)
            panel.set_xlim(left=0.0)
        panels[0].set_yticks(
            places, [f"{ROW_TITLES[row]} · {switches(row)}" if switches(row) else ROW_TITLES[row] for row in members],
        )
        figure.suptitle(f"Every row on the test set “{test_set}”", x=0.01, ha="left", fontweight="bold", fontsize=11)
        figure.set_size_inches(10.5, 1.6 + 0.34 * len(members))
    return figure


def hold_out_bars(runs: Sequence[AblationRun], test_sets: Sequence[str], *, rows: Sequence[str]) -> Figure:
    """MEE of some rows on every test set: a group of bars a set, on a logarithmic axis."""
    members = {row: found for row, found in by_row(runs).items() if row in rows}
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        width = 0.8 / max(1, len(members))
        for index, (row, runs_of_row) in enumerate(members.items()):
            figures = [over_seeds(runs_of_row, name, "mee") for name in test_sets]
            places = np.arange(len(test_sets)) + (index - (len(members) - 1) / 2.0) * width
            colour = "#888888" if row == "no-motion" else COLOURS[index % len(COLOURS)]
            axes.bar(
                places, [np.nan if item is None else item[0] for item in figures], 0.92 * width, color=colour,
                label=ROW_TITLES[row],
            )
        axes.set_yscale("log")
        axes.set_xticks(np.arange(len(test_sets)), list(test_sets))
        axes.grid(False, axis="x")
        axes.set(ylabel="Mean Euclidean error [mm]", title="What no model has seen")
        axes.legend(fontsize=9, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.1))
    return figure


def data_need_curve(runs: Sequence[AblationRun], test_set: str, *, all_positions: int) -> Figure:
    """Error against the number of training positions, both axes logarithmic, the untrained baselines as lines."""
    few = [run for run in runs if run.positions is not None]
    whole = [run for run in runs if run.positions is None and run.row == few[0].row and run.seed == few[0].seed]
    curve = sorted((run.positions or all_positions, run) for run in (*few, *whole))
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        metrics = {"mee": "MEE", "rigid_mee": "Rigid MEE", "soft_mee": "Soft MEE"}
        for index, (metric, label) in enumerate(metrics.items()):
            axes.plot(
                [count for count, _ in curve], [run.mean(test_set, metric) or np.nan for _, run in curve],
                color=COLOURS[index], marker=MARKERS[index], label=f"{ROW_TITLES[few[0].row]}, {label}",
            )
        for row, colour in (("no-motion", "#888888"), ("elastic-prior", "#000000")):
            found = over_seeds(by_row(runs).get(row, []), test_set, "mee")
            if found is not None:
                axes.axhline(found[0], color=colour, linestyle="--", linewidth=1.2, label=f"{ROW_TITLES[row]}, MEE")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks([count for count, _ in curve], [str(count) for count, _ in curve], minor=False)
        axes.minorticks_off()
        axes.set(xlabel="Training positions", ylabel="Error [mm]", title="Need for data")
        axes.legend(fontsize=9)
    return figure
