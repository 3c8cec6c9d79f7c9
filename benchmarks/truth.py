"""How far discretisations are from the converged solution of their own equations.

``python -m benchmarks.truth [--mesh MESH.vtu]`` presses the probe at three positions on the back, rotations 0° and
90°, and reads force, vertebra motion and field at 5, 10, 15 and 20 mm. Each mesh is solved with linear and quadratic
cells as it is, with linear ones of which every edge is halved, and with quadratic cells refined under the probe to
several edge lengths, always on the same facets. The error that the size of cells under the probe leaves falls with
a power of their edge length (`mixpinn.fem.local_refinement`); two lengths, one twice the other, are extrapolated to
none. The reference is the extrapolation from the two finest; its uncertainty is how far it is from that of the next
pair, told for other orders too. What cells along the border of the held skin leave falls with their edge length:
beside edges of ``--rest`` mm under the probe, cells along the border are halved to 12 and 6 mm, and what both tend to
beyond the mesh as it is belongs to the reference; poses without are left out. For the poses ``--halved`` every edge
is halved besides; the change tells what all other cells leave, and is printed.

Every solve is kept in the cache (``MIXPINN_CACHE``), so that a run goes on where an earlier one ended; a pose that was
interrupted is pressed again, and the depths that it had reached count until then. ``--minutes`` ends a run after that
time, and poses that are missing are left out.

The last line is a JSON object. All figures are against the converged solution of the mesh's own geometry.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--mesh", type=Path, help="mesh whose facets are kept; by default the paper's")
parser.add_argument("--data", type=Path, default=Path(
    os.environ.get("MIXPINN_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
) / "patient1" / "paper", help="folder with the paper's mesh and probe")
parser.add_argument("--probe", choices=["linear", "paper"],
                    help="the built-in tool or the paper's; by default the paper's on the paper's mesh")
parser.add_argument("--joints", default="none", help="preset between the vertebrae, such as in-vivo-prone")
parser.add_argument("--levels", nargs="*", default=["linear", "quadratic", "linear halved"])
parser.add_argument("--edges", nargs="*", type=float, default=[20.0, 14.0, 10.0, 7.0],
                    help="longest edges under the probe [mm]: two lengths and their halves")
parser.add_argument("--growth", type=float, default=0.05,
                    help="of the edge length away from the probe, per mm, as a share of the edge length under it")
parser.add_argument("--rest", type=float,
                    help="edge under the probe [mm] beside which those along the border of the held skin are shorter")
parser.add_argument("--halved", nargs="*", type=int, default=[], help="poses for which all other edges are halved too")
parser.add_argument("--default", action="store_true", help="solve too what onboarding solves")
parser.add_argument("--poses", nargs="+", type=int, help="of the six, by number; by default all")
parser.add_argument("--threads", type=int, default=1)
parser.add_argument("--minutes", type=float, default=float("inf"))
if __name__ == "__main__":
    OPTIONS = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = str(OPTIONS.threads)

import numpy as np  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from benchmarks import history  # noqa: E402
from mixpinn.base.arrays import AnyArray, FloatArray  # noqa: E402
from mixpinn.base.cache import cache_folder  # noqa: E402
from mixpinn.base.files import atomic_path  # noqa: E402
from mixpinn.fem import (  # noqa: E402
    PAPER_TISSUE,
    LocalRefinement,
    PoseSimulator,
    RefinedSimulator,
    Scene,
    SolverConfig,
)
from mixpinn.fem.local_refinement import refine_under, rim_order  # noqa: E402
from mixpinn.fem.solve.held_border import finer_border  # noqa: E402
from mixpinn.fem.solve.pose_simulator import Equilibrium  # noqa: E402
from mixpinn.geometry.probe_shapes import linear_probe  # noqa: E402
from mixpinn.mesh import load_paper_mesh, refine  # noqa: E402
from mixpinn.records import Probe, ProbePath, TissueMesh  # noqa: E402

POSITIONS = np.array([[30.0, 133.0, -55.0], [50.0, 133.0, -15.0], [50.0, 133.0, 25.0]])
ROTATIONS = (0.0, 90.0)
DEPTHS = np.array([5.0, 10.0, 15.0, 20.0])
POSES = list(product(range(len(POSITIONS)), ROTATIONS))
ORDERS = (1.5, 2.0, 2.25, 2.5, 3.0)
"""Orders in the edge length that are compared."""
BORDER = (12.0, 6.0)
"""Edges along the border of the held skin, one twice the other [mm]."""


@dataclass(frozen=True, eq=False)
class Press:
    """One pose on one discretisation at the depths `DEPTHS` that converged; d depths, K parts, n vertices of the mesh.

    Attributes:
        force: that presses back along the probe's axis [N], shape (d,).
        translation: of each vertebra, at the centroid of its vertices in the mesh that was not halved [mm], (d, K, 3).
        field: displacement of the vertices of that mesh [mm], shape (d, n, 3).
        det_f: smallest at quadrature points, and at vertices, shape (d, 2).
        seconds: so far [s].
        ended: whether deeper ones were tried; a pose that was interrupted is pressed again.
    """

    force: FloatArray
    translation: FloatArray
    field: FloatArray
    det_f: FloatArray
    seconds: float
    ended: bool = False

    @staticmethod
    def empty(base: TissueMesh) -> "Press":
        """No depth yet."""
        k, n = base.n_parts, base.n_points
        return Press(np.empty(0), np.empty((0, k, 3)), np.empty((0, n, 3)), np.empty((0, 2)), 0.0)

    def deeper(
        self, force: float, translation: FloatArray, field: AnyArray, det_f: tuple[float, float], seconds: float,
    ) -> "Press":
        """This, and one depth more."""
        return Press(
            np.append(self.force, force), np.concatenate([self.translation, translation[None]]),
            np.concatenate([self.field, np.asarray(field, dtype=np.float64)[None]]),
            np.concatenate([self.det_f, [det_f]]), seconds,
        )


def press(
    simulator: PoseSimulator, base: TissueMesh, pose: tuple[int, float], reached: Callable[[Press], None],
) -> Press:
    """Press to 20 mm and read the depths; the solver divides the path into moves of 1.25 mm.

    `reached` is called with what there is so far at every depth but the last.
    """
    place, rotation_deg = POSITIONS[pose[0]], pose[1]
    turn = Rotation.from_euler("y", rotation_deg, degrees=True).as_matrix()
    began, system = time.perf_counter(), simulator.system
    shift = np.array([
        base.points[base.part_nodes(k)].mean(axis=0) - system.mesh.points[system.mesh.part_nodes(k)].mean(axis=0)
        for k in range(1, base.n_parts + 1)
    ]).reshape(-1, 3)
    found = Press.empty(base)
    last: Equilibrium | None = None
    for depths in np.split(np.concatenate([[-5.0, 0.0], DEPTHS]), np.arange(3, 2 + len(DEPTHS))):
        path = ProbePath(place - depths[:, None] * [0.0, 1.0, 0.0], np.tile(turn, (len(depths), 1, 1)), depths)
        piece, last = simulator.follow(path, start=last)
        if not piece.converged.all():
            break
        turned = np.einsum("kij,kj->ki", piece.part_rotation[-1], shift) - shift
        state = last.balance.state
        found = found.deeper(
            piece.probe_wrench[-1, 1], piece.part_translation[-1] + turned, piece.displacement[-1][: base.n_points],
            (system.min_jacobian(state), float(system.vertex_jacobians(state).min())), time.perf_counter() - began,
        )
        if len(found.force) < len(DEPTHS):
            reached(found)
    return replace(found, ended=True)


def press_as_onboarding(scene: Scene, pose: tuple[int, float]) -> Press:
    """The same with a scene's refinement: two edge lengths, extrapolated and corrected, in steps of 1.25 mm."""
    place, rotation_deg = POSITIONS[pose[0]], pose[1]
    turn = Rotation.from_euler("y", rotation_deg, degrees=True).as_matrix()
    depths = np.concatenate([[-5.0], np.arange(0.0, DEPTHS[-1] + 0.1, 1.25)])
    path = ProbePath(place - depths[:, None] * [0.0, 1.0, 0.0], np.tile(turn, (len(depths), 1, 1)), depths)
    found = RefinedSimulator(scene).run(path)
    read = np.flatnonzero(np.isin(depths, DEPTHS) & found.converged)
    lowest = np.stack([found.min_jacobian[read], np.full(len(read), np.nan)], axis=1)
    field = found.displacement[read, : scene.mesh.n_points].astype(np.float64)
    return Press(
        found.probe_wrench[read, 1], found.part_translation[read], field, lowest, float(found.seconds.sum()), True,
    )


def kept(path: Path) -> Press | None:
    """A press from the cache."""
    if not path.is_file():
        return None
    with np.load(path) as stored:
        return Press(**{name: stored[name] for name in ("force", "translation", "field", "det_f")},
                     seconds=float(stored["seconds"]), ended=bool(stored.get("ended", True)))


def keep(path: Path, found: Press) -> None:
    """Write a press into the cache."""
    with atomic_path(path) as temporary, Path(temporary).open("wb") as file:
        np.savez(file, **vars(found))


def level_of(edge: float) -> str:
    """Name of the level whose quadratic cells are refined to this edge length under the probe."""
    return f"edges of {edge:g} mm"


def border_of(edge: float, border: float) -> str:
    """Name of the level whose edges along the border of the held skin are made shorter too."""
    return f"{level_of(edge)}, {border:g} mm along the held border"


def rest_of(edge: float) -> str:
    """Name of the level whose other edges are halved besides."""
    return f"{border_of(edge, BORDER[-1])}, all others halved"


def extrapolation_of(edge: float) -> str:
    """Name of what levels of this edge length and its double tend to."""
    return f"{level_of(edge)} and {2.0 * edge:g} mm, extrapolated"


def default_of() -> str:
    """Name of what onboarding solves."""
    return f"{extrapolation_of(LocalRefinement().edge)}, held border corrected"


def approach(number: int) -> ProbePath:
    """Where the probe goes in a pose, as far as cells under it are concerned."""
    place, rotation_deg = POSITIONS[POSES[number][0]], POSES[number][1]
    turn = Rotation.from_euler("y", rotation_deg, degrees=True).as_matrix()
    return ProbePath(place - DEPTHS[-1:, None] * [0.0, 1.0, 0.0], turn[None], DEPTHS[-1:])


def tool(options: argparse.Namespace) -> Probe:
    """The probe that is pressed."""
    chosen = options.probe or ("paper" if options.mesh is None else "linear")
    return linear_probe() if chosen == "linear" else Probe.load(options.data / "probe_collision.stl")


def solve_all(base: TissueMesh, options: argparse.Namespace) -> dict[tuple[str, int], Press]:
    """Every level and pose that there was time for, by level and number of the pose."""
    probe = tool(options)
    deadline = time.perf_counter() + 60.0 * options.minutes
    found: dict[tuple[str, int], Press] = {}
    materials, config = (PAPER_TISSUE,) * len(base.tissue_names), SolverConfig(threads=options.threads)
    joints = Scene(base, probe, materials).joined(options.joints).joints
    edges = {level_of(edge): edge for edge in options.edges}
    levels, borders = [*options.levels, *edges], {}
    if options.rest is not None:
        borders = {border_of(options.rest, border): border for border in BORDER}
        if options.halved:
            borders[rest_of(options.rest)] = BORDER[-1]
        edges |= dict.fromkeys(borders, options.rest)
        levels += borders
    for level in levels + [default_of()] * options.default:
        mesh = refine(base.with_order(1)) if "halved" in level else base
        whole = mesh.with_order(1 if "linear" in level else 2)
        if level in borders:
            whole = finer_border(whole, borders[level])
        scene, simulator = Scene(whole, probe, materials, solver=config, joints=joints), None
        if level == default_of():
            scene = replace(scene, refinement=LocalRefinement())
        asked = options.poses or range(len(POSES))
        for number in asked if level not in borders or "halved" not in level else options.halved:
            if level in edges:
                finer = LocalRefinement(edges[level], options.growth * edges[level], extrapolated=False)
                scene, simulator = replace(scene, mesh=refine_under(whole, probe, approach(number), finer)), None
            path = cache_folder("truth", scene.hash()) / f"pose_{number}.npz"
            result = kept(path)
            if (result is None or not result.ended) and time.perf_counter() < deadline:
                if level == default_of():
                    result = press_as_onboarding(scene, POSES[number])
                else:
                    simulator = simulator or PoseSimulator(scene)
                    result = press(simulator, base, POSES[number], partial(keep, path))
                keep(path, result)
            if result is not None:
                found[level, number] = result
                lowest = result.det_f.min(axis=0, initial=np.inf)
                print(f"{level:16s} {scene.mesh.n_nodes:7d} nodes, pose {number}: force "
                      f"{np.array2string(result.force, precision=3)} N, det F from {lowest[0]:.3f} at quadrature "
                      f"points, {lowest[1]:.3f} at vertices, {result.seconds:.0f} s", flush=True)
    return found


def combination(terms: list[tuple[float, Press]]) -> Press:
    """Sum of presses times factors over the depths that all reached; det F and time are those of the first."""
    d = min(len(one.force) for _, one in terms)
    force, translation, field = (
        np.sum([factor * getattr(one, name)[:d] for factor, one in terms], axis=0)
        for name in ("force", "translation", "field")
    )
    return Press(force, translation, field, terms[0][1].det_f[:d], terms[0][1].seconds, True)


def extrapolate(found: dict[tuple[str, int], Press], edges: list[float], *, order: float) -> list[float]:
    """Add what pairs of edge lengths tend to by an order; the shorter length of each pair, ascending."""
    further = 1.0 / (2.0**order - 1.0)
    pairs = sorted(edge for edge in edges if 2.0 * edge in edges)
    for edge, number in product(pairs, range(len(POSES))):
        coarse, fine = (found.get((level_of(length), number)) for length in (2.0 * edge, edge))
        if coarse is None or fine is None:
            continue
        found[extrapolation_of(edge), number] = combination([(1.0 + further, fine), (-further, coarse)])
    return pairs


def by_order(found: dict[tuple[str, int], Press], edges: list[float]) -> dict[str, dict[str, float]]:
    """By order of extrapolation: how far what the next pair of lengths tends to is from the finest's, at most."""
    pairs = sorted(edge for edge in edges if 2.0 * edge in edges)[:2]
    study: dict[str, dict[str, float]] = {}
    for order in ORDERS if len(pairs) == 2 else ():
        more, row = 1.0 / (2.0**order - 1.0), {"poses": 0.0}
        for number in range(len(POSES)):
            levels = [[found.get((level_of(length), number)) for length in (2.0 * edge, edge)] for edge in pairs]
            told = [
                combination([(1.0 + more, fine), (-more, coarse)])
                for coarse, fine in levels if coarse is not None and fine is not None
            ]
            if len(told) == 2:
                worst(row, errors(told[1], told[0]))
        study[f"{order:g}"] = row
    return study


def change(found: dict[tuple[str, int], Press], edge: float, number: int) -> list[tuple[float, Press]]:
    """What cells along the border of the held skin tend to beyond the mesh as it is, in a pose, as terms of a sum."""
    levels = (border_of(edge, BORDER[1]), border_of(edge, BORDER[0]), level_of(edge))
    solved = [found.get((level, number)) for level in levels]
    return [(factor, one) for factor, one in zip((2.0, -1.0, -1.0), solved, strict=True) if one is not None]


def errors(one: Press, truth: Press) -> dict[str, float]:
    """Largest errors over the depths that both reached; `vertebra_bar` in units of 2 % or 0.05 mm, the larger."""
    n = min(len(one.force), len(truth.force))
    apart = np.linalg.norm(one.translation[:n] - truth.translation[:n], axis=2)
    size = np.linalg.norm(truth.translation[:n], axis=2)
    return {
        "force": float(np.abs(one.force[:n] / truth.force[:n] - 1.0).max(initial=0.0)),
        "vertebra_mm": float(apart.max(initial=0.0)),
        "vertebra_rel": float((apart / np.maximum(size, 1e-9)).max(initial=0.0)),
        "field_mm": float(np.linalg.norm(one.field[:n] - truth.field[:n], axis=2).mean(axis=1).max(initial=0.0)),
        "vertebra_bar": float((apart / np.maximum(0.02 * size, 0.05)).max(initial=0.0)),
    }


def worst(row: dict[str, float], more: dict[str, float]) -> None:
    """One pose more in a row of largest errors."""
    row["poses"] += 1.0
    for key, value in more.items():
        row[key] = max(row.get(key, 0.0), value)


def report(
    found: dict[tuple[str, int], Press], edges: list[float], *, order: float, rest: float | None,
) -> dict[str, object]:
    """Errors of every level against the reference, over poses where both are there."""
    pairs = extrapolate(found, edges, order=order)
    rows: dict[str, dict[str, float]] = {}
    reference = extrapolation_of(pairs[0]) if pairs else ""
    poses = [number for number in range(len(POSES)) if (reference, number) in found]
    truth = {number: found[reference, number] for number in poses}
    border, unsure, halved = ({"poses": 0.0} for _ in range(3))
    for number in list(poses):
        if rest is None:
            break
        more = change(found, rest, number)
        if len(more) < 3:
            poses.remove(number)
            continue
        plain, finest = truth[number], more[0][1]
        truth[number] = combination([(1.0, plain), *more])
        worst(border, errors(plain, truth[number]))
        worst(unsure, errors(combination([(1.0, plain), (1.0, finest), more[2]]), truth[number]))
        besides = found.get((rest_of(rest), number))
        if besides is not None:
            worst(halved, errors(finest, besides))
    for (level, number), one in found.items():
        if number not in poses or level == reference:
            continue
        worst(rows.setdefault(level, {"poses": 0.0}), errors(one, truth[number]))
    uncertain: dict[str, float] = {"poses": 0.0}
    for number in poses if len(pairs) > 1 else ():
        next_pair = found.get((extrapolation_of(pairs[1]), number))
        worst(uncertain, {} if next_pair is None else errors(next_pair, found[reference, number]))
    forces: dict[str, dict[int, list[float]]] = {}
    for (level, number), one in sorted(found.items()):
        forces.setdefault(level, {})[number] = one.force.tolist()
    return {
        "poses": len(poses), "reference": reference, "rows": rows, "forces": forces,
        "border": border, "border_uncertainty": unsure, "halved": halved, "orders": by_order(found, edges),
        "uncertainty": {key: uncertain.get(key) for key in ("force", "vertebra_mm", "field_mm")},
    }


def main(options: argparse.Namespace) -> None:
    """Solve, compare, print."""
    base = TissueMesh.load(options.mesh) if options.mesh else load_paper_mesh(options.data)
    base = base.with_order(1)
    probe = tool(options)
    result = report(solve_all(base, options), options.edges, order=rim_order(probe), rest=options.rest)
    rows = result["rows"]
    assert isinstance(rows, dict)
    for level, row in rows.items():
        print(f"{level:40s} force {100 * row['force']:.2f} %, vertebra {row['vertebra_mm']:.3f} mm "
              f"({row['vertebra_bar']:.2f} of the bar), field {row['field_mm']:.4f} mm, {row['poses']:.0f} poses")
    default = rows.get(default_of()) or rows.get(extrapolation_of(LocalRefinement().edge), {})
    linear = rows.get("linear", {})
    history.report("truth", {
        "force_error_max": default.get("force"), "vertebra_error_max_mm": default.get("vertebra_mm"),
        "vertebra_error_max_rel": default.get("vertebra_rel"), "field_error_max_mm": default.get("field_mm"),
        "paper_force_error_max": linear.get("force"),
        "mesh": "paper" if options.mesh is None else base.hash(), "vertices": base.n_points,
        "joints": options.joints, "probe": probe.name, "order": rim_order(probe), **result,
    })


if __name__ == "__main__":
    main(OPTIONS)
    sys.exit(0)
