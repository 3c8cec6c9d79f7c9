"""The paper's networks at their full width, trained with equal budgets, several seeds each, and tested.

``python -m benchmarks.full_width STORE --out DIR [--models row-1 row-2 row-10 row-11] [--seeds 0 1] [--epochs 10]``
trains every model of the list with every seed, on a GPU where there is one, and measures the errors at the test
positions of the split ``every-fifth``. What is finished is kept in DIR, so that a run with the same settings goes on
where an earlier one ended; ``--at-once N`` trains N networks at a time, each in a process of its own, and
``--minutes`` begins none after that time. The table, and the ratios by which virtual nodes (row 10) and virtual edges
(row 11) lower the rigid error, are written to ``DIR/full-width.md``; the last line is a JSON object.

Errors are those against the recordings in the store, on their own mesh.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.history import report
from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.files import write_json, write_text
from mixpinn.base.progress import console
from mixpinn.dataset import SimulationStore
from mixpinn.evaluation.evaluate import evaluate
from mixpinn.graph import Scaling
from mixpinn.networks import load_checkpoint, mesh_output
from mixpinn.records import TissueMesh
from mixpinn.stages.samples import SplitConfig, choose_samples, load_samples
from mixpinn.stages.training import ModelsConfig, train_model
from mixpinn.training import TrainConfig

ERRORS = ("mee", "rigid_mee", "soft_mee", "ree")
PAIRS = (("row-1", "row-10"), ("row-2", "row-10"), ("row-1", "row-11"), ("row-2", "row-11"))
"""Without and with virtual nodes or edges. Row 2 has the same two heads as rows 10 and 11; row 1 has one."""


class OnDevice:
    """A trained network, asked on the device that it was trained on."""

    def __init__(self, folder: Path, mesh: TissueMesh, name: str, device: torch.device) -> None:
        self.name, self.device = name, device
        model, _, _ = load_checkpoint(folder, mesh=mesh)
        self.model, self.n_points = model.to(device), mesh.n_points

    @torch.no_grad()
    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], shape (n, 3)."""
        field = torch.zeros(1, self.n_points, 3)
        field[0, torch.from_numpy(np.asarray(nodes, dtype=np.int64))] = torch.as_tensor(
            np.asarray(displacements, dtype=np.float32),
        )
        answer: Float32Array = mesh_output(self.model, self.model(field.to(self.device)))[0].cpu().numpy()
        return answer


def settings_of(options: argparse.Namespace) -> dict[str, Any]:
    """What a network is trained with, besides its name and seed."""
    return {"epochs": options.epochs, "width": options.width, "learning_rate": options.learning_rate}


def finished(options: argparse.Namespace, name: str, seed: int) -> dict[str, Any] | None:
    """The result of a model and seed; None where there is none with these settings."""
    path = options.out / f"{name}-seed-{seed}" / "result.json"
    if not path.is_file():
        return None
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result if result.get("settings") == settings_of(options) else None


def run_one(options: argparse.Namespace, name: str, seed: int) -> None:
    """Train and test one network; the result is written last."""
    folder = options.out / f"{name}-seed-{seed}"
    store, began = SimulationStore.open(options.store), time.perf_counter()
    table, split = load_samples(store, SplitConfig(file="every-fifth"))
    settings = TrainConfig(
        learning_rate=options.learning_rate, max_epochs=options.epochs, seed=seed, threads=options.threads,
    )
    models = ModelsConfig(names=(name,), width=options.width, scaling=Scaling.STANDARD, train=settings)
    trained = train_model(store, table, split, name, models, out=folder)
    mesh, device = store.mesh(), torch.device("cuda" if torch.cuda.is_available() else "cpu")
    test = table.select(choose_samples(table, split, None).test)
    found = evaluate(OnDevice(folder, mesh, name, device), test, mesh, split="test")
    write_json(folder / "result.json", {
        "model": name, "seed": seed, "settings": settings_of(options), "epochs": len(trained.history),
        "best_epoch": trained.best_epoch,
        "validation_loss": trained.best_validation_loss, "training_seconds": trained.seconds, "samples": len(test),
        "device": torch.cuda.get_device_name() if device.type == "cuda" else "CPU",
        "minutes": (time.perf_counter() - began) / 60.0,
        **{error: float(np.mean(found.metrics[error])) for error in ERRORS},
    })


def run_all(options: argparse.Namespace) -> None:
    """Every model and seed that is missing, each in a process of its own; the first seeds first."""
    deadline = time.monotonic() + 60.0 * options.minutes
    waiting = [
        (seed, name) for seed, name in product(options.seeds, options.models) if finished(options, name, seed) is None
    ]
    running: list[tuple[subprocess.Popen[bytes], str]] = []
    while waiting or running:
        while waiting and len(running) < options.at_once and time.monotonic() < deadline:
            seed, name = waiting.pop(0)
            command = [
                sys.executable, "-m", "benchmarks.full_width", str(options.store), "--out", str(options.out),
                "--models", name, "--seeds", str(seed), "--epochs", str(options.epochs), "--width", options.width,
                "--learning-rate", str(options.learning_rate), "--threads", str(options.threads), "--one",
            ]
            options.out.mkdir(parents=True, exist_ok=True)
            with (options.out / f"{name}-seed-{seed}.txt").open("ab") as log:
                running.append((subprocess.Popen(command, stdout=log, stderr=log), f"{name}, seed {seed}"))
        if time.monotonic() >= deadline:
            waiting.clear()
        time.sleep(0.5)
        for process, what in [entry for entry in running if entry[0].poll() is not None]:
            running.remove((process, what))
            console.print(f"{what}: {'done' if process.returncode == 0 else f'failed ({process.returncode})'}")


def results(options: argparse.Namespace) -> list[dict[str, Any]]:
    """What is finished, in the order of models and seeds."""
    found = (finished(options, name, seed) for name, seed in product(options.models, options.seeds))
    return [one for one in found if one is not None]


def gains(found: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By what factor the second of each of `PAIRS` lowers the rigid error: mean, least and greatest over seeds."""
    value = {(one["model"], one["seed"]): one["rigid_mee"] for one in found}
    factors = {
        f"{plain} to {virtual}": [
            value[plain, seed] / value[virtual, seed] for name, seed in value
            if name == plain and (virtual, seed) in value
        ] for plain, virtual in PAIRS
    }
    return {
        pair: {"mean": float(np.mean(each)), "least": min(each), "greatest": max(each), "seeds": len(each)}
        for pair, each in factors.items() if each
    }


def table(found: Sequence[dict[str, Any]], factors: dict[str, dict[str, float]]) -> str:
    """Both tables as Markdown."""
    lines = ["| Model | Seed | MEE [mm] | Rigid MEE [mm] | Soft MEE [mm] | REE [mm] | Best epoch | Training [s] | On |",
             "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |"]
    lines += [
        f"| {one['model']} | {one['seed']} | " + " | ".join(f"{one[error]:.4f}" for error in ERRORS)
        + f" | {one['best_epoch']} | {one['training_seconds']:.0f} | {one['device']} |" for one in found
    ]
    lines += ["", "| Rigid MEE lowered | Mean factor | Least | Greatest | Seeds |",
              "| --- | ---: | ---: | ---: | ---: |"]
    lines += [
        f"| {pair} | {one['mean']:.2f} | {one['least']:.2f} | {one['greatest']:.2f} | {one['seeds']} |"
        for pair, one in factors.items()
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Train what is missing, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=["row-1", "row-2", "row-10", "row-11"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--width", default="authors")
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        run_one(options, options.models[0], options.seeds[0])
        return
    run_all(options)
    found = results(options)
    factors = gains(found)
    text = table(found, factors)
    write_text(options.out / "full-width.md", text)
    print(text)
    report("full_width", {"runs": found, "gains": factors}, kept={
        **{f"{one['model']} seed {one['seed']} rigid_mee": one["rigid_mee"] for one in found},
        **{f"{pair} factor": one["mean"] for pair, one in factors.items()},
    })


if __name__ == "__main__":
    main()
