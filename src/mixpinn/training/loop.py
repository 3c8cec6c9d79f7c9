"""The training loop of the paper: AdamW, plateau decay, early stop, on one device or several."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import torch
from rich.progress import Progress
from torch import Tensor, nn

from mixpinn.base.errors import InputError, SolveError
from mixpinn.base.progress import console, progress_bar
from mixpinn.graph import MeshGraph
from mixpinn.models import ModelConfig, build_graph_for, build_model, describe_training, save_checkpoint
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training.batches import batch_count, batches, check_table
from mixpinn.training.config import TrainConfig
from mixpinn.training.history import EpochRecord, StopReason, TrainingResult, write_history
from mixpinn.training.objective import training_loss
from mixpinn.training.schedule import Schedule
from mixpinn.training.state import epoch_seed, load_state, save_state

if TYPE_CHECKING:
    from lightning.fabric import Fabric

Accelerator = Literal["auto", "cpu", "cuda", "mps"]
