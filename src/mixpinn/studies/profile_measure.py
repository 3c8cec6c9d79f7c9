"""One measurement of the run-time table, in a process of its own: time of a prediction and the memory it takes."""

import multiprocessing
import os
import time
from dataclasses import asdict, dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import Float32Array, FloatArray
from mixpinn.base.child_process import GRACE, end_all, end_with_parent, script_left_alone
from mixpinn.base.errors import MixpinnError
from mixpinn.dataset.local_pool import deaf_to_interrupts, pinned_threads
from mixpinn.networks import MODELS, ModelConfig
from mixpinn.records import SampleTable, TissueMesh

PRIOR = "elastic-prior"
TIMEOUT = 3600.0
"""By default a measurement that takes longer is ended [s]."""


@dataclass(frozen=True)
class Timing:
    """How long one method takes on one mesh, one sample at a time, warm.

    Attributes:
        mesh: name of the mesh.
        nodes, edges: of the mesh, edges directed.
        method: ``fem``, ``elastic-prior`` or a model of the tables.
        device: where it ran.
        threads: CPU threads.
        repeats: measured predictions, or steps of the solver.
        mean_ms, median_ms, p95_ms: wall time, from input array to output array [ms].
        peak_mb: what the method added to the memory of a process that had all libraries loaded [MB], its weights and
            graph included; None where the system does not tell.
        by_depth_ms: median wall time by depth [mm] of the samples [ms].
    """

    mesh: str
    nodes: int
    edges: int
    method: str
    device: str
    threads: int
    repeats: int
    mean_ms: float
    median_ms: float
    p95_ms: float
    peak_mb: float | None
    by_depth_ms: dict[str, float]


def timing(
    seconds: FloatArray, depth: FloatArray, *, mesh: tuple[str, TissueMesh], method: str, device: str, threads: int,
    peak_mb: float | None,
) -> Timing:
    """Sum up wall times [s] of single predictions or steps at depths [mm], both of shape (r,)."""
    name, shape = mesh
    milliseconds, bins = 1e3 * seconds, np.round(depth)
    return Timing(
        name, shape.n_points, 2 * len(shape.edges), method, device, threads, len(seconds), float(milliseconds.mean()),
        float(np.median(milliseconds)), float(np.quantile(milliseconds, 0.95)), peak_mb,
        {f"{value:g}": float(np.median(milliseconds[bins == value])) for value in np.unique(bins)},
    )


def resident_mb(key: str) -> float | None:
    """``VmRSS`` (now) or ``VmHWM`` (peak) of this process [MB]; None where the system has no such file."""
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    return next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith(key)) / 1024.0


def forget_peak() -> None:
    """Let the peak of this process's memory begin anew; does nothing where the system cannot."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5")


def model_config(method: str, *, hidden: int, physgnn_hidden: int) -> ModelConfig:
    """The network of a method of the tables at a width."""
    listed = MODELS[method]
    return replace(listed, hidden=physgnn_hidden if listed.architecture == "physgnn" else hidden)


def measure_model(
    config: ModelConfig, samples: SampleTable, mesh: tuple[str, TissueMesh], *, method: str, threads: int,
    repeats: int, timeout: float = TIMEOUT,
) -> Timing:
    """Time an untrained network, whose cost is that of a trained one, on `samples` in turn, in a process of its own.

    Raises:
        MixpinnError: the process failed, or took too long.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, config, samples, mesh, method, threads, repeats, os.getpid()))
    with pinned_threads(threads), deaf_to_interrupts(), script_left_alone():
        process.start()
    there.close()
    what = f"measuring {method} on mesh {mesh[0]}"
    try:
        if not here.poll(timeout):
            raise MixpinnError(f"{what} took more than {timeout:g} s and was ended")
        result: dict[str, Any] = here.recv()
        process.join(GRACE)
    except EOFError:
        process.join()
        raise MixpinnError(f"{what} ended with code {process.exitcode}") from None
    finally:
        end_all([process])
        here.close()
    return Timing(**result)


def _serve(
    connection: Connection, config: ModelConfig, samples: SampleTable, mesh: tuple[str, TissueMesh], method: str,
    threads: int, repeats: int, parent: int,
) -> None:
    end_with_parent(parent)
    import torch

    torch.set_num_threads(threads)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    predict, peak = _loaded(config, samples, mesh[1], device)
    seconds, depth = [], []
    for turn in range(repeats):
        index = turn % len(samples)
        field = samples.contact_field(index)[: mesh[1].n_points]
        began = time.perf_counter()
        predict(field)
        seconds.append(time.perf_counter() - began)
        depth.append(samples.depth[index])
    connection.send(asdict(timing(
        np.array(seconds), np.array(depth), mesh=mesh, method=method, device=device, threads=threads, peak_mb=peak(),
    )))
    connection.close()


def _loaded(config: ModelConfig, samples: SampleTable, mesh: TissueMesh, device: str) -> tuple[Any, Any]:
    """A prediction on `mesh`, warmed up, and what it has added to the memory at its peak."""
    import torch

    from mixpinn.networks import build_graph_for, build_model

    def load(on: TissueMesh) -> Any:
        model = build_model(config, build_graph_for(config, on)).to(device).eval()

        def predict(field: Float32Array) -> Float32Array:
            with torch.inference_mode():
                out: Float32Array = model(torch.from_numpy(field)[None].to(device))[0].cpu().numpy()
            return out

        return predict

    # The libraries load their kernels with the first prediction; a single cell is enough for that.
    load(single_cell())(np.zeros((4, 3), dtype=np.float32))
    before = resident_mb("VmRSS")
    forget_peak()
    predict = load(mesh)
    for index in range(2):
        predict(samples.contact_field(index % len(samples))[: mesh.n_points])

    def peak() -> float | None:
        highest = resident_mb("VmHWM")
        return None if before is None or highest is None else highest - before

    return predict, peak


def single_cell() -> TissueMesh:
    """One tetrahedron, half of it rigid."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    part = np.array([0, 0, 1, 1], dtype=np.int16)
    return TissueMesh(
        points, np.array([[0, 1, 2, 3]], dtype=np.int32), part, np.zeros(4, dtype=bool), ("A",),
        np.zeros(1, dtype=np.int16),
    )
