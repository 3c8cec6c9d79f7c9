"""Simulations whose configurations are kept in double precision: recordings store displacements in single precision."""

from dataclasses import dataclass

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, PoseSimulator, Scene, State
from mixpinn.records import ProbePath, Simulation


@dataclass(frozen=True, eq=False)
class Watched:
    """A simulation with the configuration of each recorded step.

    Attributes:
        simulation: the recording.
        states: configurations in double precision.
        system: the elastic bodies.
    """

    simulation: Simulation
    states: list[State]
    system: ElasticSystem

    def nodal_forces(self, step: int) -> FloatArray:
        """Contact force on each node at a step [N], shape (n, 3)."""
        forces = self.states[step].points * 0.0
        span = slice(*self.simulation.contact_offsets[step : step + 2])
        forces[self.simulation.contact_nodes[span]] = self.simulation.contact_forces[span]
        return forces


def watch(scene: Scene, path: ProbePath) -> Watched:
    """Simulate `path`, keeping the configurations."""
    simulator = PoseSimulator(scene)
    states: list[State] = []
    measure = simulator.system.min_jacobian

    def remember(state: State) -> float:  # every recorded step is measured once
        states.append(state)
        return measure(state)

    simulator.system.min_jacobian = remember  # type: ignore[method-assign]
    simulation = simulator.run(path)
    return Watched(simulation, states, simulator.system)
