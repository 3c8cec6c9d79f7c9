"""Metrics, tables, plots, pictures and the report."""

from mixpinn.evaluation.evaluate import DisplacementModel, VirtualDisplacementModel, ZeroModel, evaluate
from mixpinn.evaluation.metrics import (
    AS_PUBLISHED,
    MetricGeometry,
    VirtualTopology,
    errors_by_part,
    euclidean_errors,
    mean_absolute_error,
    mean_euclidean_error,
    mean_squared_error,
    rigid_edge_error,
    sample_metrics,
    virtual_reference,
)
from mixpinn.evaluation.paper import (
    PAPER_ABLATION,
    PAPER_DATASET,
    PAPER_MESH,
    PAPER_RESULTS,
    PAPER_RUNTIME,
    PaperAblation,
    PaperResult,
)
from mixpinn.evaluation.plots import (
    error_against_depth,
    error_by_part,
    error_distribution,
    figure_png,
    loss_curves,
    save_figure,
)
from mixpinn.evaluation.rendering import Case, Picture, render_comparison, render_cut, render_error_map, render_pictures
from mixpinn.evaluation.rendering_backend import RenderingUnavailable, start_rendering
from mixpinn.evaluation.report import LIMITS, Headline, ReportContent, summarise_run, write_report
from mixpinn.evaluation.statistics import (
    DepthProfile,
    Summary,
    bootstrap_interval,
    depth_profile,
    summarise,
    summarise_metrics,
    summarise_parts,
    typical_sample,
)
from mixpinn.evaluation.table import Table, format_cell
from mixpinn.evaluation.tables import (
    METRIC_LABELS,
    ablation_table,
    dataset_counts_table,
    depth_table,
    mesh_table,
    part_table,
    results_table,
    runtime_table,
    spread_table,
)

__all__ = [
    "AS_PUBLISHED", "LIMITS", "METRIC_LABELS", "PAPER_ABLATION", "PAPER_DATASET", "PAPER_MESH", "PAPER_RESULTS",
    "PAPER_RUNTIME", "Case", "DepthProfile", "DisplacementModel", "Headline", "MetricGeometry", "PaperAblation",
    "PaperResult", "Picture", "RenderingUnavailable", "ReportContent", "Summary", "Table", "VirtualDisplacementModel",
    "VirtualTopology", "ZeroModel", "ablation_table", "bootstrap_interval", "dataset_counts_table", "depth_profile",
    "depth_table", "error_against_depth", "error_by_part", "error_distribution", "errors_by_part", "euclidean_errors",
    "evaluate", "figure_png", "format_cell", "loss_curves", "mean_absolute_error", "mean_euclidean_error",
    "mean_squared_error", "mesh_table", "part_table", "render_comparison", "render_cut", "render_error_map",
    "render_pictures", "results_table", "rigid_edge_error", "runtime_table", "sample_metrics", "save_figure",
    "spread_table", "start_rendering", "summarise", "summarise_metrics", "summarise_parts", "summarise_run",
    "typical_sample", "virtual_reference", "write_report",
]
