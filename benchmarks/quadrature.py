"""Which quadrature ten-node cells should have: the force of a probe on a coarse, nearly incompressible block.

``python -m benchmarks.quadrature [--cells 5 3 4]`` presses the built-in linear probe 15 mm into a block of 100 × 50 ×
80 mm with that many cells along each side, ν = 0.45 and 0.495, once with each rule, and prints the forces. Force falls
on finer meshes, so that the rule with the lower one is nearer to the converged solution. The last line is JSON.
"""

import argparse
import sys

import numpy as np

from benchmarks.history import report
from mixpinn.fem import ContactConfig, ElasticSystem, PoseSimulator, Scene, StableNeoHookean
from mixpinn.fem.solve.quasi_static import QuasiStaticSolver
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.physics.quadrature import TETRAHEDRON_4, TETRAHEDRON_8, TETRAHEDRON_14, Quadrature
from mixpinn.records import ProbePath, TissueMesh
from validation.blocks import block, labelled

SIZE = (100.0, 50.0, 80.0)
DEPTHS = np.array([0.0, 5.0, 10.0, 15.0])


def forces(mesh: TissueMesh, poisson: float, rule: Quadrature) -> list[float]:
    """Force of the probe at each of `DEPTHS` [N]."""
    simulator = PoseSimulator(Scene(mesh, linear_probe(), (StableNeoHookean.from_young(25.4e-3, poisson),)))
    simulator.system = ElasticSystem(mesh, simulator.scene.materials, quadrature=rule)
    simulator.solver = QuasiStaticSolver(simulator.system, simulator.contact, simulator.scene.solver)
    gap = ContactConfig().gap
    places = np.array([0.5 * SIZE[0], SIZE[1] + gap, 0.5 * SIZE[2]]) - DEPTHS[:, None] * [0.0, 1.0, 0.0]
    found = simulator.run(ProbePath(places, np.tile(np.eye(3), (len(DEPTHS), 1, 1)), DEPTHS))
    return [float(value) if done else float("nan") for value, done in zip(
        found.probe_wrench[:, 1], found.converged, strict=True,
    )]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", nargs=3, type=int, default=[5, 3, 4])
    options = parser.parse_args()
    mesh = block(tuple(options.cells), size=SIZE, shake=0.15, rng=np.random.default_rng(0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9).with_order(2)
    result: dict[str, list[float]] = {}
    for poisson in (0.45, 0.495):
        for rule in (TETRAHEDRON_4, TETRAHEDRON_8, TETRAHEDRON_14):
            result[f"{poisson:g}, {rule.name}"] = values = forces(mesh, poisson, rule)
            print(f"nu {poisson:g}, {rule.name}: {np.array2string(np.array(values), precision=3)} N", flush=True)
    report("quadrature", result)


if __name__ == "__main__":
    main()
    sys.exit(0)
