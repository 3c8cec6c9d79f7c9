"""Cost against size: one tangent, its factorization and one solve on ever finer meshes, each in its own process."""

import multiprocessing
import resource
import time
from pathlib import Path

import numpy as np

from mixpinn.fem import ElasticSystem, StableNeoHookean, default_solver
from validation.blocks import block, labelled
from validation.result import Result, Section, picture

SIZES = (5_000, 20_000, 80_000)


def measure(nodes: int) -> tuple[int, float, float, float, float]:
    """Nodes, seconds of assembly, factorization and solve, and peak memory added [MB] for a cube of about `nodes`."""
    n = round(nodes ** (1.0 / 3.0)) - 1
    mesh = block((n, n, n), size=(300.0, 300.0, 300.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    system = ElasticSystem(mesh, [StableNeoHookean.from_young(25.4e-3, 0.45)])
    state, linear = system.rest_state(), default_solver(1)
    residual = np.random.default_rng(0).normal(size=system.n_dofs)
    linear.factorize(system.tangent(state))  # symbolic analysis, paid once a mesh
    marks = [time.perf_counter()]
    matrix = system.tangent(state)
    marks.append(time.perf_counter())
    linear.factorize(matrix)
    marks.append(time.perf_counter())
    linear.solve(residual)
    marks.append(time.perf_counter())
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    return mesh.n_points, *np.diff(marks).tolist(), memory


def run(folder: Path, *, sizes: tuple[int, ...] = SIZES) -> Section:
    """Measure each size in a fresh process, so that the peaks of memory are apart."""
    rows = []
    for size in sizes:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            rows.append(pool.apply(measure, (size,)))
    table = np.array(rows, dtype=float)
    total = table[:, 1:4].sum(axis=1)
    nodes = np.log(table[:, 0])
    time_exponent = float(np.polyfit(nodes, np.log(total), 1)[0])
    memory_exponent = float(np.polyfit(nodes, np.log(table[:, 4]), 1)[0])

    def draw(axes):  # type: ignore[no-untyped-def]
        for column, name in ((1, "assembly"), (2, "factorization"), (3, "solve")):
            axes.loglog(table[:, 0], table[:, column], "o-", label=f"{name} [s]")
        axes.loglog(table[:, 0], table[:, 4] / 1000.0, "s--", label="memory [GB]")
        axes.set(xlabel="nodes")
        axes.legend(frameon=False, fontsize=8)

    header = ("nodes", "assembly [s]", "factorization [s]", "solve [s]", "memory [MB]")
    lines = [(f"{row[0]:.0f}", f"{row[1]:.3f}", f"{row[2]:.3f}", f"{row[3]:.3f}", f"{row[4]:.0f}") for row in table]
    return Section(
        "Cost against size",
        "A cube fixed at one face, one thread: one assembly, one numerical factorization with the symbolic phase kept, "
        "one solve. Nested dissection of a solid block promises exponents of 2 in time and 4/3 in memory for large "
        "meshes.",
        (
            Result.at_most("cost against size, exponent of time", time_exponent, 2.2),
            Result.at_most("cost against size, exponent of memory", memory_exponent, 1.5),
        ),
        picture(folder, "scaling", draw), (header, *lines),
    )
