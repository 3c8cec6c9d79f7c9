"""Simulations whose configurations are kept in double precision: recordings store displacements in single precision."""

from dataclasses import dataclass
from typing import Any

from mixpinn.base.arrays import FloatArray
from mixpinn.fem import ElasticSystem, PoseSimulator, Scene, State
from mixpinn.fem.contact.model import ContactModel, FrictionFrame, ProbePose
from mixpinn.records import ProbePath, Simulation
from validation.contact.probe_side import ContactPoints, contact_points


@dataclass(frozen=True, eq=False)
class Watched:
    """A simulation with the configuration of each recorded step.

    Attributes:
        simulation: the recording.
        states: configurations in double precision.
        frames: pose of the probe and what friction referred to when each of them was found.
        system: the elastic bodies.
        contact: probe, skin and laws.
    """

    simulation: Simulation
    states: list[State]
    frames: list[tuple[ProbePose, FrictionFrame]]
    system: ElasticSystem
    contact: ContactModel

    def nodal_forces(self, step: int) -> FloatArray:
        """Contact force on each node at a step [N], shape (n, 3)."""
        forces = self.states[step].points * 0.0
        span = slice(*self.simulation.contact_offsets[step : step + 2])
        forces[self.simulation.contact_nodes[span]] = self.simulation.contact_forces[span]
        return forces

    def contact_points(self, step: int) -> ContactPoints:
        """Forces at the contact points of a step, evaluated anew from the probe's side."""
        return contact_points(self.contact, self.contact.skin.vertices(self.states[step].points), *self.frames[step])


def watch(scene: Scene, path: ProbePath) -> Watched:
    """Simulate `path`, keeping the configurations."""
    simulator = PoseSimulator(scene)
    states: list[State] = []
    frames: list[tuple[ProbePose, FrictionFrame]] = []
    measure, solve = simulator.system.min_jacobian, simulator.solver.solve
    last: list[tuple[ProbePose, FrictionFrame]] = []

    def remember(state: State) -> float:  # every recorded step is measured once, after its last solve
        states.append(state)
        frames.append(last[-1])
        return measure(state)

    def follow(state: State, pose: ProbePose, frame: FrictionFrame) -> Any:
        last[:] = [(pose, frame)]
        return solve(state, pose, frame)

    simulator.system.min_jacobian = remember  # type: ignore[method-assign]
    simulator.solver.solve = follow  # type: ignore[method-assign, assignment]
    simulation = simulator.run(path)
    return Watched(simulation, states, frames, simulator.system, simulator.contact)
