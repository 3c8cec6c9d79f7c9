"""Poses, splits, generation and the store of simulations."""

from mixpinn.dataset.ahead import SimulationsAhead
from mixpinn.dataset.dask_pool import connect_dask
from mixpinn.dataset.dataset_table import DatasetTable, dataset_table
from mixpinn.dataset.generation import generate
from mixpinn.dataset.holdouts import (
    HOLD_OUT_NAMES,
    HOLD_OUTS,
    NOISE,
    NOISE_MM,
    SampleSplit,
    Selector,
    beyond,
    deeper_than,
    held_out_samples,
    hold_out,
    lateral_to,
    rotation_is,
    split_samples,
    with_contact_noise,
)
from mixpinn.dataset.inverted_cells import InvertedCell, inverted_cells, list_inverted
from mixpinn.dataset.local_pool import pinned_threads
from mixpinn.dataset.pose_map import draw_pose_map, save_pose_map
from mixpinn.dataset.pose_order import farthest_first
from mixpinn.dataset.positions import grid_positions, left_at_ends, plan_poses, thin_positions
from mixpinn.dataset.protocol import (
    ANATOMY,
    PAPER,
    PROTOCOLS,
    SMALL,
    SOFA_REPLAY,
    TINY,
    Pose,
    Protocol,
    list_poses,
    probe_path,
    read_positions,
)
from mixpinn.dataset.sample_table import ContactRule, build_sample_table, table_of
from mixpinn.dataset.split import Split, split_positions, split_sofa_subset
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.dataset.summary import GenerationSummary, summarise
from mixpinn.dataset.worker import Runner, run_pose

__all__ = [
    "ANATOMY",
    "HOLD_OUTS",
    "HOLD_OUT_NAMES",
    "NOISE",
    "NOISE_MM",
    "PAPER",
    "PROTOCOLS",
    "SMALL",
    "SOFA_REPLAY",
    "TINY",
    "ContactRule",
    "DatasetTable",
    "GenerationSummary",
    "InvertedCell",
    "Pose",
    "PoseState",
    "PoseStatus",
    "Protocol",
    "Runner",
    "SampleSplit",
    "Selector",
    "SimulationStore",
    "SimulationsAhead",
    "Split",
    "beyond",
    "build_sample_table",
    "connect_dask",
    "dataset_table",
    "deeper_than",
    "draw_pose_map",
    "farthest_first",
    "generate",
    "grid_positions",
    "held_out_samples",
    "hold_out",
    "inverted_cells",
    "lateral_to",
    "left_at_ends",
    "list_inverted",
    "list_poses",
    "pinned_threads",
    "plan_poses",
    "probe_path",
    "read_positions",
    "rotation_is",
    "run_pose",
    "save_pose_map",
    "split_positions",
    "split_samples",
    "split_sofa_subset",
    "summarise",
    "table_of",
    "thin_positions",
    "with_contact_noise",
]
