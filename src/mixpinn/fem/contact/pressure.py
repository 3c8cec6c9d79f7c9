"""Contact area and pressure of a simulated step, from its displacements and contact forces."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.geometry.proximity import Triangulation, proximity
from mixpinn.records import Probe, Simulation, TissueMesh
from mixpinn.records.answer import discretisation_of


@dataclass(frozen=True, eq=False)
class ContactPressure:
    """Where and how hard the probe presses, on c loaded skin nodes.

    Attributes:
        nodes: mesh nodes, shape (c,).
        area: skin that belongs to each of them in the deformed state, as the probe sees it [mm²], shape (c,).
        force: of the probe on each, along its axis, positive in pressing [N], shape (c,).
    """

    nodes: IntArray
    area: FloatArray
    force: FloatArray

    @property
    def pressure(self) -> FloatArray:
        """Force over area of each node [N/mm²], shape (c,); zero where a node has no skin that faces the probe."""
        return np.divide(self.force, self.area, out=np.zeros_like(self.force), where=self.area > 0.0)

    @property
    def mean_pressure(self) -> float:
        """Force of all nodes over their area [N/mm²]; zero without contact."""
        return float(self.force.sum() / self.area.sum()) if self.area.sum() > 0.0 else 0.0


def contact_pressure(
    mesh: TissueMesh, simulation: Simulation, step: int, *, direction: FloatArray | None = None,
) -> ContactPressure:
    """Pressure on the loaded skin nodes at a step.

    A node's area is a third of the deformed skin triangles around it, each projected along the direction d in which
    the probe presses: Σ (−a · d)₊ / 3 with the outward area vectors a. Triangles that do not face the probe count
    nothing, so that the rim of a flat body has half an area and not more. With the force f on the node, the pressure
    is f · d over that area: the one that, acting uniformly on these triangles, gives the node that force. A node beside
    the rim of the contact carries a part of the load on all of its triangles; its pressure is a mean over them, and
    the nodes' area in all exceeds the area of contact (`contact_area`) by up to an edge at the rim.

    Quadratic faces load their midpoints above all: their forces are first taken to the vertices as the linear shape
    functions see them (`TissueMesh.on_vertices`), and the nodes are then vertices alone.

    Args:
        mesh: the mesh that was simulated.
        simulation: of one pose.
        step: index of the step.
        direction: unit vector d in the world frame, shape (3,); by default the probe's −y axis at that step.

    Raises:
        InputError: a simulation of another mesh, or no such step.

    Example:
        >>> found = contact_pressure(mesh, simulation, step=2)
        >>> bool(found.pressure.max() >= found.mean_pressure)
        True
    """
    _check(mesh, simulation, step)
    if direction is None:
        direction = simulation.path.rotations[step] @ PROBE_AXIS
    nodes, forces = simulation.contacts(step)
    if mesh.order == 2:
        nodal = np.zeros((mesh.n_nodes, 3))
        nodal[nodes] = forces
        vertices = mesh.on_vertices(nodal)
        nodes = np.flatnonzero((vertices != 0.0).any(axis=1) & np.isin(np.arange(mesh.n_points), mesh.skin_faces))
        forces = vertices[nodes]
    moved = mesh.points + simulation.displacement[step, : mesh.n_points]
    a, b, c = np.moveaxis(moved[mesh.skin_faces], 1, 0)
    facing = np.maximum(-0.5 * np.cross(b - a, c - a) @ direction, 0.0) / 3.0
    area: FloatArray = np.zeros(mesh.n_points)
    np.add.at(area, mesh.skin_faces, facing[:, None])
    return ContactPressure(nodes, area[nodes], forces @ direction)


def contact_area(
    mesh: TissueMesh, probe: Probe, simulation: Simulation, step: int, *, gap: float = 2.0, slack: float = 0.1,
    spacing: float = 0.5,
) -> float:
    """Area of the deformed skin on which the probe lies at a step [mm²].

    Contact acts at a distance, so that skin which touches lies within the gap of the probe's surface. The skin's
    triangles are divided into pieces no longer than `spacing`, and those count whose centre is no farther from the
    probe than gap and slack. A coarse skin bridges hollows between the places where it touches: on it the area
    grows with the slack, and only where the skin is fine enough to follow the probe does it not depend on it.

    Args:
        mesh: the mesh that was simulated.
        probe: the tool that was used.
        simulation: of one pose.
        step: index of the step.
        gap: distance at which contact acts [mm], `ContactConfig.gap`.
        slack: distance from the gap that still counts as contact [mm].
        spacing: length of the pieces [mm].

    Raises:
        InputError: a simulation of another mesh, or no such step.
    """
    _check(mesh, simulation, step)
    if not len(simulation.contacts(step)[0]):
        return 0.0
    corners = probe.points @ simulation.path.rotations[step].T + simulation.path.translations[step]
    skin = (mesh.node_points + simulation.displacement[step])[mesh.skin_triangles]
    reach = gap + slack
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    near = ((skin.max(axis=1) >= low) & (skin.min(axis=1) <= high)).all(axis=1)
    surface, area = Triangulation.build(probe.triangles, len(corners)), 0.0
    for triangle in skin[near]:
        edges = np.roll(triangle, -1, axis=0) - triangle
        n = max(1, int(np.ceil(np.linalg.norm(edges, axis=1).max() / spacing)))
        centres = _piece_centres(n) @ triangle
        touching = np.unique(proximity(centres, corners, surface, cutoff=reach).point)
        area += 0.5 * float(np.linalg.norm(np.cross(edges[0], edges[1]))) * len(touching) / n**2
    return area


def _piece_centres(n: int) -> FloatArray:
    """Barycentric weights of the centres of the n² equal pieces of a triangle, shape (n², 3)."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    upright, turned = i + j < n, i + j < n - 1
    first = np.concatenate([i[upright] + 1.0 / 3.0, i[turned] + 2.0 / 3.0]) / n
    second = np.concatenate([j[upright] + 1.0 / 3.0, j[turned] + 2.0 / 3.0]) / n
    return np.column_stack([first, second, 1.0 - first - second])


def _check(mesh: TissueMesh, simulation: Simulation, step: int) -> None:
    if simulation.mesh_hash != mesh.hash():
        raise InputError(
            "contact pressure", expected=f"a simulation of {discretisation_of(mesh)}",
            got=f"one of another mesh, {simulation.mesh_hash}",
            fix="give the mesh of the simulation's own store: SimulationStore.open(folder).mesh()",
        )
    if not 0 <= step < simulation.n_steps:
        raise InputError(
            "contact pressure", expected=f"a step from 0 to {simulation.n_steps - 1}", got=str(step),
            fix="choose another step",
        )
