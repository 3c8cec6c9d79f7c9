"""The networks on one GPU: the same answers as the CPU, time of inference and of a training step, and training.

``python -m benchmarks.gpu STORE --out DIR [--minutes 8]`` compares every network of the paper's tables with the CPU
(outputs, and gradients of the training loss), times inference and a training step of rows 2 and 10 and of PhysGNN at
both of the paper's widths with batches of 1 and 4, in float32 and with bfloat16 products, and spends the time that is
left on training rows 2 and 10 at full width on the store's recordings, both for the same number of epochs
(``--epochs``, at most those of the time left), with `benchmarks.full_width`. The last line is a JSON object. Without a
GPU it says so and ends with exit code 2.
"""

import argparse
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.history import report
from mixpinn.dataset import SimulationStore
from mixpinn.graph import Scaling
from mixpinn.networks import MODELS, DisplacementModel, ModelConfig, build_graph_for
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.stages.samples import SplitConfig, choose_samples, load_samples
from mixpinn.stages.training import ModelsConfig
from mixpinn.training.batches import Batch, batches
from mixpinn.training.objective import new_model, training_loss

NETWORKS = ("physgnn", *(f"row-{number}" for number in range(1, 14)))
TIMED = ("row-2", "row-10", "physgnn")


def configuration(name: str, width: str) -> ModelConfig:
    """One of the paper's networks, with inputs and outputs scaled."""
    return ModelsConfig(names=(name,), width=width, scaling=Scaling.STANDARD).model(name)


def loss_and_gradients(
    model: DisplacementModel, config: ModelConfig, batch: Batch, device: str,
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Prediction, loss and gradient of every weight, on `device`, brought to the CPU in float64."""
    model = model.to(device)
    model.zero_grad()
    predicted = model(batch.contact_displacement.to(device))
    loss = training_loss(config, model.graph, predicted, batch.target.to(device))
    loss.backward()  # type: ignore[no-untyped-call]
    gradients = {
        name: weight.grad.detach().cpu().double()
        for name, weight in model.named_parameters() if weight.grad is not None
    }
    return predicted.detach().cpu().double(), loss.detach().cpu().double(), gradients


def agreement(name: str, mesh: TissueMesh, table: SampleTable) -> dict[str, float]:
    """Largest differences between CPU and GPU, each relative to the largest value."""
    config = configuration(name, "authors")
    # Gradients of recurrent layers need training mode on a GPU; dropout, which draws other numbers there, is left out.
    model = new_model(config, build_graph_for(config, mesh), table, seed=0).train()
    for layer in model.modules():
        if isinstance(layer, torch.nn.Dropout):
            layer.p = 0.0
    batch = next(iter(batches(table, model.graph, batch_size=2)))
    on_cpu, on_gpu = (loss_and_gradients(model, config, batch, device) for device in ("cpu", "cuda"))
    scale = max(float(gradient.abs().max()) for gradient in on_cpu[2].values())
    return {
        "output": float((on_cpu[0] - on_gpu[0]).abs().max() / on_cpu[0].abs().max()),
        "loss": float((on_cpu[1] - on_gpu[1]).abs() / on_cpu[1]),
        "gradient": max(float((on_cpu[2][key] - on_gpu[2][key]).abs().max()) for key in on_cpu[2]) / scale,
    }


def median_ms(action: Callable[[], object], *, repeats: int = 20, warm_up: int = 3) -> float:
    """Median wall time of `action` with all of the GPU's work in it [ms]."""
    seconds = []
    for turn in range(repeats + warm_up):
        torch.cuda.synchronize()
        began = time.perf_counter()
        action()
        torch.cuda.synchronize()
        if turn >= warm_up:
            seconds.append(time.perf_counter() - began)
    return 1e3 * statistics.median(seconds)


def times(
    name: str, width: str, batch_size: int, precision: torch.dtype, mesh: TissueMesh, table: SampleTable,
) -> dict[str, Any]:
    """Inference and a training step of one network [ms], and the memory that the step takes [GiB]."""
    config = configuration(name, width)
    model = new_model(config, build_graph_for(config, mesh), table, seed=0).to("cuda")
    batch = next(iter(batches(table, model.graph, batch_size=batch_size)))
    field, target = batch.contact_displacement.to("cuda"), batch.target.to("cuda")
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-12)
    products = torch.autocast("cuda", dtype=precision, enabled=precision != torch.float32)

    @torch.no_grad()
    def infer() -> None:
        with products:
            model(field)

    def step() -> None:
        optimizer.zero_grad()
        with products:
            loss = training_loss(config, model.graph, model(field), target)
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()

    inference = median_ms(infer)
    torch.cuda.reset_peak_memory_stats()
    training = median_ms(step)
    return {
        "model": name, "width": width, "batch": batch_size, "precision": str(precision).removeprefix("torch."),
        "inference_ms": inference, "training_ms": training, "gib": torch.cuda.max_memory_allocated() / 2**30,
    }


def train_rows(options: argparse.Namespace, minutes: float) -> None:
    """Rows 2 and 10 for equal passes, side by side."""
    run_within(60.0 * minutes, [
        sys.executable, "-m", "benchmarks.full_width", str(options.store), "--out", str(options.out / "training"),
        "--models", "row-2", "row-10", "--seeds", "0", "--epochs", str(options.epochs), "--at-once", "2",
    ])


def run_within(seconds: float, command: Sequence[str]) -> None:
    """Run a command; after that time it ends with all that it has started.

    Raises:
        TimeoutExpired: it was ended.
    """
    process = subprocess.Popen(command, start_new_session=True)
    try:
        process.wait(timeout=seconds)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise


def main() -> None:
    """Compare, time, train, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--no-training", action="store_true")
    options = parser.parse_args()
    if not torch.cuda.is_available():
        print("benchmarks.gpu: expected a CUDA device, got none; run it on a machine with a GPU", file=sys.stderr)
        raise SystemExit(2)
    began = time.monotonic()
    left = lambda: options.minutes - (time.monotonic() - began) / 60.0  # noqa: E731
    store = SimulationStore.open(options.store)
    table, split = load_samples(store, SplitConfig(file="every-fifth"))
    table, mesh = table.select(choose_samples(table, split, None).train), store.mesh()
    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}, {mesh.n_points} nodes", flush=True)
    same = {}
    for name in NETWORKS:
        same[name] = agreement(name, mesh, table)
        print(f"{name:8s} GPU − CPU, relative: " + ", ".join(f"{k} {v:.1e}" for k, v in same[name].items()), flush=True)
    rows = []
    for name in TIMED:
        for width in ("authors",) if MODELS[name].architecture == "physgnn" else ("authors", "paper"):
            for batch_size in (1, 4):
                for precision in (torch.float32, torch.bfloat16):
                    if left() < 0.5:
                        continue
                    rows.append(times(name, width, batch_size, precision, mesh, table))
                    one = rows[-1]
                    print(f"{name:8s} {width:8s} batch {batch_size} {one['precision']:9s} inference "
                          f"{one['inference_ms']:7.2f} ms, training step {one['training_ms']:7.2f} ms, "
                          f"{one['gib']:.1f} GiB", flush=True)
                    torch.cuda.empty_cache()
    if not options.no_training and left() > 1.0:
        try:
            train_rows(options, left())
        except subprocess.TimeoutExpired:
            print("training was ended by --minutes; run the same command again to go on with it", flush=True)
    worst = {key: float(np.max([value[key] for value in same.values()])) for key in ("output", "loss", "gradient")}
    report("gpu", {
        "device": torch.cuda.get_device_name(), "agreement": same, "times": rows,
        "minutes": (time.monotonic() - began) / 60.0,
        **{f"{key}_difference_max": value for key, value in worst.items()},
    }, kept={
        "device": torch.cuda.get_device_name(), **worst,
        **{f"{one['model']} {one['width']} batch {one['batch']} {one['precision']} {kind}_ms": one[f"{kind}_ms"]
           for one in rows for kind in ("inference", "training")},
    })


if __name__ == "__main__":
    main()
