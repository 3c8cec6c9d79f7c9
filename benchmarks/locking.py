"""Linear against quadratic cells in a linear problem: how stiff the back answers, and how far vertebrae move.

``python -m benchmarks.locking [MESH.vtu ...] [--halved]`` takes the paper's mesh where none is named. A smooth pressure
p = exp(−((x − x₀)/24)⁴ − ((z − z₀)/10)⁴) [mm] along −y acts on the skin that faces backwards, E = 25.4 kPa and
ν = 0.45; depth is the mean displacement along −y, weighted by the pressure. Printed are force / depth [N/mm] and the
largest motion of a vertebra per depth, at (x₀, z₀) = (30, −55), (50, 25) and (0, 0). ``--halved`` solves the mesh with
every edge halved too, where memory allows. The last line is a JSON object.
"""

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.history import report
from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, LinearElastic, default_solver
from mixpinn.mesh import load_paper_mesh, refine
from mixpinn.physics.face_points import FacePoints
from mixpinn.records import TissueMesh

PLACES = np.array([[30.0, -55.0], [50.0, 25.0], [0.0, 0.0]])
TISSUE = LinearElastic.from_young(25.4e-3, 0.45)


def loads(mesh: TissueMesh) -> tuple[FloatArray, FloatArray]:
    """Nodal loads along −y of the three unit pressures, and those less the pressures' forces; shapes (3, n), (3,).

    The face's shape functions carry the pressure, integrated at points about 2 mm apart.
    """
    faces = mesh.skin_node_faces
    corners = mesh.points[faces[:, :3]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    back = normals[:, 1] > 0.0
    faces, corners, normals = faces[back], corners[back], normals[back]
    points = FacePoints.build(faces, corners, spacing=2.0)
    # area seen along y: the pressure acts along −y on what faces backwards
    seen = points.area * (normals[:, 1] / np.linalg.norm(normals, axis=1))[points.face]
    where = np.einsum("pw,pwk->pk", points.weights, mesh.node_points[points.vertices])
    result = np.zeros((len(PLACES), mesh.n_nodes))
    for row, (x, z) in zip(result, PLACES, strict=True):
        pressure = np.exp(-(((where[:, 0] - x) / 24.0) ** 4) - ((where[:, 2] - z) / 10.0) ** 4)
        np.add.at(row, points.vertices, points.weights * (pressure * seen)[:, None])
    return result, result.sum(axis=1)


def answer(mesh: TissueMesh) -> dict[str, object]:
    """Force / depth and vertebra motion / depth of the three loads on one discretisation."""
    began = time.perf_counter()
    system = ElasticSystem(mesh, [TISSUE] * len(mesh.tissue_names))
    rest, (push, force) = system.rest_state(), loads(mesh)
    solver = default_solver(int(os.environ.get("OMP_NUM_THREADS", "1")))
    solver.factorize(system.tangent(rest))
    right = np.zeros((system.n_dofs, len(PLACES)))
    for column, row in zip(right.T, push, strict=True):
        column[:] = system.reduce(np.outer(row, [0.0, -1.0, 0.0]), rest)
    stiffness, motion = [], []
    for solution, row, total in zip(solver.solve(right).T, push, force, strict=True):
        depth = float(-(system.expand(solution, rest)[:, 1] * row).sum() / total)
        twist = solution[system.n_dofs - 6 * mesh.n_parts :].reshape(-1, 6)
        stiffness.append(float(total / depth))
        motion.append(float(np.linalg.norm(twist[:, :3], axis=1).max(initial=0.0) / depth))
    return {
        "nodes": mesh.n_nodes, "force_per_depth": stiffness, "vertebra_per_depth": motion,
        "seconds": time.perf_counter() - began,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--halved", action="store_true")
    parser.add_argument("--data", type=Path, default=Path(
        os.environ.get("MIXPINN_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
    ) / "patient1" / "paper")
    options = parser.parse_args()
    meshes = {str(path): TissueMesh.load(path).with_order(1) for path in options.meshes}
    meshes = meshes or {"paper": load_paper_mesh(options.data)}
    result: dict[str, dict[str, object]] = {}
    for name, mesh in meshes.items():
        levels = [("linear", mesh), ("quadratic", mesh.with_order(2))]
        if options.halved:
            fine = refine(mesh)
            levels += [("linear halved", fine), ("quadratic halved", fine.with_order(2))]
        for level, one in levels:
            found = answer(one)
            result[f"{name} {level}"] = found
            print(f"{name} {level}: {found['nodes']} nodes, force/depth "
                  f"{np.array2string(np.array(found['force_per_depth']), precision=3)} N/mm, vertebra/depth "
                  f"{np.array2string(np.array(found['vertebra_per_depth']), precision=3)}, {found['seconds']:.1f} s",
                  flush=True)
    report("locking", result)


if __name__ == "__main__":
    main()
    sys.exit(0)
