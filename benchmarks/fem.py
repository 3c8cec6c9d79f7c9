"""Seconds a depth step of the finite-element solver, and where they go.

``python -m benchmarks.fem`` simulates poses one after another and prints a table and, as its last line, a JSON object.
It takes the paper's mesh, probe and positions, found by the environment variable MIXPINN_DATA (default
``../shared/data``), or a block of soft tissue under a built-in probe where they are absent. Threads are pinned before
any numerical library is loaded. A first short pose, which compiles the kernels, does not count.
"""

import argparse
import os
import sys
import time
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--threads", type=int, default=2)
parser.add_argument("--poses", type=int, default=4)
parser.add_argument("--order", type=int, default=1, choices=(1, 2), help="of the cells: 1 linear, 2 quadratic")
if __name__ == "__main__":
    OPTIONS = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = str(OPTIONS.threads)

import numpy as np  # noqa: E402

from benchmarks.history import report  # noqa: E402
from mixpinn.fem import PAPER_TISSUE, PoseSimulator, Scene, SolverConfig  # noqa: E402
from mixpinn.geometry.probe_shapes import linear_probe  # noqa: E402
from mixpinn.geometry.rotations import rotation_about_y  # noqa: E402
from mixpinn.mesh import load_paper_mesh  # noqa: E402
from mixpinn.records import Probe, ProbePath, Simulation, TissueMesh  # noqa: E402
from validation.blocks import labelled  # noqa: E402
from validation.kuhn import grid_points, kuhn_cells  # noqa: E402

ROTATIONS = (0.0, 45.0, 90.0, 135.0)


def paper_set_up() -> tuple[TissueMesh, Probe, np.ndarray] | None:
    """Mesh, probe and positions [mm] of the paper, if they are there."""
    default = Path(__file__).parents[1] / ".." / "shared" / "data"
    folder = Path(os.environ.get("MIXPINN_DATA", default)) / "patient1" / "paper"
    if not (folder / "body.vtu").is_file():
        return None
    return (
        load_paper_mesh(folder), Probe.load(folder / "probe_collision.stl"),
        np.loadtxt(folder / "probe_positions.txt"),
    )


def block_set_up() -> tuple[TissueMesh, Probe, np.ndarray]:
    """A block of 200 × 120 × 200 mm with about 9,000 nodes, fixed below, and four positions on it."""
    counts = (21, 16, 21)
    lengths = zip((200.0, 120.0, 200.0), counts, strict=True)
    points = grid_points(*(np.linspace(0.0, length, n + 1) for length, n in lengths))
    mesh = labelled(points, kuhn_cells(counts), fixed=points[:, 1] == 0.0)
    positions = np.array([[80.0, 122.0, 80.0], [120.0, 122.0, 80.0], [80.0, 122.0, 120.0], [120.0, 122.0, 120.0]])
    return mesh, linear_probe(), positions


def press(simulator: PoseSimulator, position: np.ndarray, rotation_deg: float, steps: int = 28) -> Simulation:
    """From 8 mm above `position` down in steps of 1 mm."""
    rotation = rotation_about_y(rotation_deg)
    depth = np.arange(steps) - 8.0
    translations = position - depth[:, None] * [0.0, 1.0, 0.0]
    return simulator.run(ProbePath(translations, np.tile(rotation, (steps, 1, 1)), depth))


def main(threads: int, poses: int, order: int = 1) -> None:
    """Measure and print."""
    found = paper_set_up()
    mesh, probe, positions = found or block_set_up()
    mesh = mesh.with_order(order)
    simulator = PoseSimulator(Scene(mesh, probe, (PAPER_TISSUE,), solver=SolverConfig(threads=threads)))
    press(simulator, positions[0], 0.0, steps=14)
    effort = simulator.solver.effort
    before = (effort.iterations, effort.factorizations, dict(effort.seconds))
    seconds, loaded, failed, penetration, residual = 0.0, 0, 0, 0.0, 0.0
    cpu = time.process_time()
    for k, index in enumerate(np.linspace(0, len(positions) - 1, poses).round().astype(int)):
        simulation = press(simulator, positions[index], ROTATIONS[k % 4])
        steps = simulation.sample_steps()
        seconds += float(simulation.seconds[steps].sum())
        loaded += len(steps)
        failed += int((~simulation.converged).sum())
        penetration = max(penetration, float(simulation.penetration[steps].max()))
        residual = max(residual, float(simulation.residual[steps].max()))
        force = np.linalg.norm(simulation.probe_wrench[-1, :3])
        print(f"pose {index:4d} at {ROTATIONS[k % 4]:5.1f}°: {len(steps)} steps with load, "
              f"{simulation.seconds[steps].mean():.3f} s each, force {force:.1f} N")
    cpu = time.process_time() - cpu
    shares = {name: (value - before[2][name]) / seconds for name, value in effort.seconds.items()}
    shares["other"] = 1.0 - sum(shares.values())
    report("fem", {
        "seconds_per_step": seconds / loaded, "iterations_per_step": (effort.iterations - before[0]) / loaded,
        "factorizations_per_step": (effort.factorizations - before[1]) / loaded, "shares": shares,
        "cpu_seconds_per_step": cpu / loaded, "steps": loaded, "failed_steps": failed, "penetration_mm": penetration,
        "residual": residual, "threads": threads, "mesh": "paper" if found else "block", "nodes": mesh.n_nodes,
        "order": order,
    })


if __name__ == "__main__":
    main(OPTIONS.threads, OPTIONS.poses, OPTIONS.order)
    sys.exit(0)
