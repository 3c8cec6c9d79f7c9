"""The run-time table: time of each method on each mesh, how it grows, and whether it depends on depth."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from mixpinn.evaluation.paper import PAPER_RUNTIME
from mixpinn.evaluation.plots import COLOURS, MARKERS, PLOT_STYLE, new_figure
from mixpinn.evaluation.table import Cell, Table
from mixpinn.studies.ablation_tables import ROW_TITLES

METHOD_TITLES = {**ROW_TITLES, "fem": "Finite elements, one step"}
SHOWN = ("fem", "elastic-prior", "row-1", "row-10", "row-11", "physgnn")
"""Methods in the pictures."""

Row = Mapping[str, Any]
"""One timing as plain values, see `mixpinn.studies.profile_measure.Timing`."""


def profile_table(timings: Sequence[Row], made_on: Mapping[str, str] | None = None) -> Table:
    """Every method on every mesh, the paper's times below, muted.

    Args:
        timings: all of them.
        made_on: discretisation of each mesh in words, by its name.
    """
    rows: list[tuple[Cell, ...]] = [
        (
            METHOD_TITLES[entry["method"]], entry["mesh"], entry["nodes"], entry["median_ms"], entry["p95_ms"],
            entry["peak_mb"], f"{entry['device']}, {entry['threads']}", entry["repeats"],
        )
        for entry in timings
    ]
    measured = len(rows)
    rows += [
        (f"{name} (paper)", "paper", 8746, milliseconds, None, None, "64-core CPU, RTX 4090", None)
        for name, milliseconds in PAPER_RUNTIME.items()
    ]
    columns = (
        "Method", "Mesh", "Nodes", "Median [ms]", "95th percentile [ms]", "Peak memory [MB]", "Device, threads",
        "Repeats",
    )
    note = (
        "Wall time of one depth step of 1 mm with contact, or of one prediction: batch 1, warm, from input array to "
        "output array. Peak memory is what a network adds to a process that has all libraries loaded. Rows marked "
        "(paper) are quoted: means on another machine."
    )
    note += "".join(f" Mesh {name}: {words}." for name, words in (made_on or {}).items())
    return Table("Run time", columns, tuple(rows), note, frozenset(range(measured, len(rows))))


def exponent(nodes: Sequence[float], milliseconds: Sequence[float]) -> float | None:
    """p of the least-squares fit time ∝ nodes^p; None for fewer than two sizes."""
    if len(set(nodes)) < 2:
        return None
    slope, _ = np.polyfit(np.log(nodes), np.log(milliseconds), 1)
    return float(slope)


def exponent_table(timings: Sequence[Row]) -> Table:
    """How the cost of each method grows with the number of nodes, and with depth from its first to its last bin."""
    rows: list[tuple[Cell, ...]] = []
    for method in dict.fromkeys(entry["method"] for entry in timings):
        of_method = [entry for entry in timings if entry["method"] == method]
        largest = max(of_method, key=lambda entry: entry["nodes"])
        by_depth = sorted((float(depth), time) for depth, time in largest["by_depth_ms"].items())
        third = max(1, len(by_depth) // 3)
        shallow, deep = (
            float(np.median([time for _, time in part])) for part in (by_depth[:third], by_depth[-third:])
        )
        rows.append((
            METHOD_TITLES[method],
            exponent([entry["nodes"] for entry in of_method], [entry["median_ms"] for entry in of_method]),
            deep / shallow,
        ))
    note = (
        "Exponent p of time ∝ nodes^p by least squares over the meshes. Deep / shallow: median time of the deepest "
        "third of the steps over that of the shallowest third, on the finest mesh; 1 means that depth does not matter."
    )
    return Table("How the cost grows", ("Method", "Exponent", "Deep / shallow"), tuple(rows), note)


BESIDE: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
"""Place of a legend beside the axes: the curves lie everywhere in them."""


def cost_figure(timings: Sequence[Row]) -> Figure:
    """Median time against the number of nodes, both axes logarithmic."""
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        for index, method in enumerate(_shown(timings)):
            of_method = sorted((e["nodes"], e["median_ms"]) for e in timings if e["method"] == method)
            axes.plot(
                *zip(*of_method, strict=True), color=_colour(method, index), marker=MARKERS[index % len(MARKERS)],
                label=METHOD_TITLES[method],
            )
        nodes = sorted({entry["nodes"] for entry in timings})
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(nodes, [f"{count:,}" for count in nodes])
        axes.minorticks_off()
        axes.set(xlabel="Nodes", ylabel="Median time [ms]", title="Cost against size")
        axes.legend(fontsize=9, **BESIDE)
    return figure


def depth_figure(timings: Sequence[Row]) -> Figure:
    """Median time against depth on the mesh nearest the paper's size."""
    figure, axes = new_figure()
    with rc_context(PLOT_STYLE):
        nearest = min(timings, key=lambda entry: abs(np.log(entry["nodes"] / 8746.0)))["mesh"]
        for index, method in enumerate(_shown(timings)):
            entry = next((e for e in timings if e["method"] == method and e["mesh"] == nearest), None)
            if entry is not None:
                by_depth = sorted((float(depth), time) for depth, time in entry["by_depth_ms"].items())
                axes.plot(
                    *zip(*by_depth, strict=True), color=_colour(method, index), marker=MARKERS[index % len(MARKERS)],
                    markersize=4, label=METHOD_TITLES[method],
                )
        axes.set_yscale("log")
        axes.set(
            xlabel="Indentation depth [mm]", ylabel="Median time [ms]", title=f"Time against depth, mesh “{nearest}”",
        )
        axes.legend(fontsize=9, **BESIDE)
    return figure


def _shown(timings: Sequence[Row]) -> list[str]:
    there = {entry["method"] for entry in timings}
    return [method for method in SHOWN if method in there]


def _colour(method: str, index: int) -> str:
    return "#000000" if method == "fem" else COLOURS[index % len(COLOURS)]
