"""Tables on the anatomy and the mesh, for the terminal and the report."""

from mixpinn.anatomy import Finding
from mixpinn.evaluation import Table
from mixpinn.mesh import MeshFidelity, MeshQuality


def findings_table(findings: tuple[Finding, ...]) -> Table:
    """What the label check found."""
    rows = tuple((f.kind, f.structure, f.detail, "yes" if f.repaired else "no") for f in findings)
    return Table("Label check", ("Finding", "Structure", "What was seen", "Repaired"), rows)


def quality_table(quality: MeshQuality) -> Table:
    """Shape of the tetrahedra."""
    return Table("Mesh quality", ("Measure", "Value"), (
        ("Smallest dihedral angle [°]", f"{quality.min_dihedral:.2f}"),
        ("1st percentile of a cell's smallest dihedral angle [°]", f"{quality.low_dihedral:.2f}"),
        ("Cells with a dihedral angle below 5°", str(quality.slivers)),
        ("Smallest radius ratio", f"{quality.min_radius_ratio:.4f}"),
        ("Median radius ratio", f"{quality.median_radius_ratio:.3f}"),
        ("Smallest cell [mm³]", f"{quality.min_volume:.3g}"),
        ("Inverted cells", str(quality.inverted)),
        ("Cells that span two rigid parts", str(quality.spanning_cells)),
    ))


def fidelity_table(fidelity: MeshFidelity) -> Table:
    """Each structure of the mesh against the label map."""
    rows = tuple(
        (s.name, round(s.dice, 4), round(s.hausdorff_95, 2), round(s.hausdorff, 2)) for s in fidelity.structures
    )
    return Table("Fidelity to the label map", ("Structure", "Dice", "Hausdorff 95 % [mm]", "Hausdorff [mm]"), rows)
