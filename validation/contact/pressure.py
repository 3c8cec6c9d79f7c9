"""Contact area and pressure where both are known."""

from pathlib import Path

import numpy as np

from mixpinn.fem import ContactConfig, LinearElastic, PoseSimulator, Scene, contact_area, contact_pressure
from mixpinn.records import Probe, ProbePath, Simulation, TissueMesh
from validation.blocks import block, labelled
from validation.result import Result, Section, picture

YOUNG = 25.4e-3
GAP, HEIGHT, PRESS = 0.25, 15.0, 0.5
WIDTH = 21.0


def flat(width: float) -> Probe:
    """A square in y = 0 that looks downwards."""
    half = 0.5 * width
    corners = np.array([[-half, 0.0, -half], [half, 0.0, -half], [half, 0.0, half], [-half, 0.0, half]])
    return Probe(corners, np.array([[0, 1, 2], [0, 2, 3]]), "flat")


def pressed(side: float, spacing: float, probe: Probe) -> tuple[TissueMesh, Simulation]:
    """A block of ν = 0, fixed below, pressed without friction in its middle."""
    counts = (round(side / spacing), 5, round(side / spacing))
    mesh = block(counts, size=(side, HEIGHT, side))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 1] < 1e-9)
    contact = ContactConfig(gap=GAP, alarm=1.0, friction=0.0, spacing=6.0)
    scene = Scene(mesh, probe, (LinearElastic.from_young(YOUNG, 0.0),), contact)
    heights, middle = HEIGHT + GAP - np.array([-0.1, 0.5 * PRESS, PRESS]), np.full(3, 0.5 * side)
    path = ProbePath(np.column_stack([middle, heights, middle]), np.tile(np.eye(3), (3, 1, 1)), np.arange(3.0))
    return mesh, PoseSimulator(scene).run(path)


def run(folder: Path) -> Section:
    """The check."""
    plate = flat(90.0)
    mesh, simulation = pressed(30.0, 3.0, plate)
    whole = contact_pressure(mesh, simulation, 2)
    strain = -simulation.displacement[-1][whole.nodes, 1].mean() / HEIGHT
    # The face is pressed flat: a square in place of the plate would lie on a known part of it.
    square = contact_area(mesh, flat(WIDTH), simulation, 2, gap=GAP, slack=0.0, spacing=0.25)
    results = [
        Result.at_most("contact area of a whole face, relative error",
                       abs(contact_area(mesh, plate, simulation, 2, gap=GAP) / 900.0 - 1.0), 0.01),
        Result.at_most("pressure E ε on a whole face, largest relative error of a node",
                       float(np.abs(whole.pressure / (YOUNG * strain) - 1.0).max()), 0.01),
        Result.at_most("contact area of a square inside the face, relative error", abs(square / WIDTH**2 - 1.0), 0.05),
    ]

    def draw(axes):  # type: ignore[no-untyped-def]
        points = mesh.points[whole.nodes]
        drawn = axes.scatter(points[:, 0], points[:, 2], c=1e3 * whole.pressure, s=18)
        axes.figure.colorbar(drawn, ax=axes, label="pressure [kPa]")
        axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")

    return Section(
        "Contact area and pressure",
        f"A block of {HEIGHT:g} mm and ν = 0 is pressed by {PRESS:g} mm without friction. Under a plate larger than "
        "the block, the contact is its face of 30 × 30 mm and the pressure is E ε at each node, the rim included; the "
        f"picture shows it. A square of {WIDTH:g} mm held against the same flattened face has an area that the skin's "
        "nodes, 3 mm apart, do not resolve, but the skin within the gap of it does.",
        tuple(results), picture(folder, "pressure", draw),
    )
