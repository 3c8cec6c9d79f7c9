"""How long answers take, on an idle and on a busy machine, and how that grows with the mesh.

``python -m benchmarks.latency BUNDLE [FINER_BUNDLE]`` times single predictions, warm, and prints as its last line a
JSON object [ms]: ``contact_ms_*`` from contact displacements to the displacement of all nodes, midpoints of edges
included; ``outputs_ms_p50`` to that of 5,000 nodes, vertices first (``nodes_asked``); ``pose_ms_*`` from the probe's
pose to field, force and motions, ``pose_cpu_ms_p50`` the processor time of that; ``busy_pose_ms_p99`` the same beside
another process that computes without pause; ``one_thread_pose_ms_p50`` with every library held to one thread, in a
process of its own; ``growth`` the median from contact on the finer bundle relative to that on the first, with outputs
at the same 5,000 places, taken in turns (null without one), whose mesh has ``finer_nodes``; ``bundle_mb`` the size of
the bundle.
``cores`` and ``load`` say what machine it was.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.history import report

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
_ASKED = 5000
_TURN = 20
"""Answers of one bundle before the other's turn."""
_parser = argparse.ArgumentParser(prog="python -m benchmarks.latency", description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("finer", type=Path, nargs="?")
_parser.add_argument("--repeats", type=int, default=400)
_parser.add_argument("--path-step", type=float, help="of contact from the pose [mm], instead of the bundle's own")
_parser.add_argument("--only-pose", action="store_true", help="time the pose alone")


def milliseconds(
    ask: Callable[[int], object], repeats: int, clock: Callable[[], float] = time.perf_counter,
) -> list[float]:
    """Wall time, or that of another clock, of `ask(0)`, `ask(1)` …, the first 20 of which do not count."""
    found = []
    for index in range(-20, repeats):
        began = clock()
        ask(index % repeats)
        if index >= 0:
            found.append(1e3 * (clock() - began))
    return found


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    import numpy as np
    from scipy.spatial import cKDTree

    from benchmarks.dependability import random_presses
    from mixpinn.press.contact import PriorContact
    from mixpinn.serving import HybridPredictor

    predictor = HybridPredictor.load(options.bundle)
    model = predictor.pose
    assert model is not None, "the bundle takes no poses"
    if options.path_step is not None:
        contact = PriorContact.of_prior(model.hybrid.prior, replace(model.contact.config, step=options.path_step))
        predictor.pose = model = replace(model, contact=contact)
    rng = np.random.default_rng(0)
    poses = [
        (press.rotation, tip) for press in random_presses(model, 20, rng)
        for tip in press.tips()[rng.integers(4, 81, size=max(1, options.repeats // 20))]
    ]

    def ask_pose(index: int) -> object:
        rotation, tip = poses[index % len(poses)]
        return predictor.press(tip, rotation=rotation)

    pose = milliseconds(ask_pose, options.repeats)
    found: dict[str, Any] = {
        "pose_ms_p50": float(np.percentile(pose, 50)), "pose_ms_p99": float(np.percentile(pose, 99)),
        "pose_cpu_ms_p50": float(np.median(milliseconds(ask_pose, options.repeats, time.process_time))),
    }
    if options.only_pose:
        return found
    contact = milliseconds(contact_ask(predictor, poses, predictor.predict), options.repeats)
    mesh = predictor.mesh
    asked = np.arange(max(mesh.n_points, min(_ASKED, mesh.n_nodes)))
    ask_outputs = contact_ask(predictor, poses, predictor.outputs(asked).predict)
    outputs = milliseconds(ask_outputs, options.repeats)
    busy = multiprocessing.get_context("spawn").Process(target=_compute, daemon=True)
    busy.start()
    time.sleep(2.0)
    beside = milliseconds(ask_pose, options.repeats)
    busy.terminate()
    growth = finer_nodes = None
    if options.finer is not None:
        other = HybridPredictor.load(options.finer)
        there = cKDTree(other.mesh.node_points).query(mesh.node_points[asked])[1]
        ask_finer = contact_ask(other, poses, other.outputs(there).predict)
        here, finer = in_turns((ask_outputs, ask_finer), options.repeats)
        growth, finer_nodes = float(np.median(finer) / np.median(here)), other.mesh.n_nodes
    return {
        "contact_ms_p50": float(np.percentile(contact, 50)), "contact_ms_p99": float(np.percentile(contact, 99)),
        "outputs_ms_p50": float(np.percentile(outputs, 50)), "nodes_asked": len(asked),
        **found, "busy_pose_ms_p99": float(np.percentile(beside, 99)),
        "one_thread_pose_ms_p50": one_thread(options.bundle, options.repeats), "growth": growth,
        "finer_nodes": finer_nodes,
        "bundle_mb": sum(file.stat().st_size for file in options.bundle.rglob("*") if file.is_file()) / 1e6,
        "nodes": mesh.n_points, "all_nodes": mesh.n_nodes, "cores": os.cpu_count(), "load": os.getloadavg()[0],
    }


def contact_ask(
    predictor: Any, poses: Sequence[tuple[Any, Any]], predict: Callable[..., object],
) -> Callable[[int], object]:
    """Asks for what `predict` makes of the contact nodes of these poses, by number."""
    asked = []
    for rotation, tip in poses:
        contact = predictor.press(tip, rotation=rotation).contact
        if len(contact.nodes):
            asked.append((contact.nodes, contact.displacement))
    return lambda index: predict(*asked[index % len(asked)])


def in_turns(asks: Sequence[Callable[[int], object]], repeats: int) -> list[list[float]]:
    """Wall times [ms] of several, a few at a time in turns: what the machine does besides hits them alike."""
    found: list[list[float]] = [[] for _ in asks]
    for start in range(0, repeats, _TURN):
        for ask, times in zip(asks, found, strict=True):
            times += milliseconds(lambda index, ask=ask, start=start: ask(start + index), _TURN)  # type: ignore[misc]
    return found


def one_thread(bundle: Path, repeats: int) -> float:
    """Median from the pose [ms] in a process whose libraries have one thread each."""
    command = [sys.executable, "-m", "benchmarks.latency", str(bundle), "--only-pose", "--repeats", str(repeats)]
    environment = {**os.environ, **dict.fromkeys(_THREADS, "1")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout.strip().splitlines()[-1])["pose_ms_p50"])


def _compute() -> None:
    """Keep one core busy."""
    total = 0
    while True:
        total = (total * 3 + 1) % 1_000_003


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    report("latency", measure(_parser.parse_args(arguments)))


if __name__ == "__main__":
    main()
