"""Stiffness of the sacroiliac and costovertebral joints, each figure with its source and range.

Of both sources the abstract was read, not the paper. They give displacements under one load; the stiffness is the load
over the displacement, a secant. Nothing was found for living people, so that every preset takes the same figures. For
the joints of hip and femur, of ribs with each other and with the sternum none are made: nothing was found that says how
they resist while a person lies prone.
"""

from mixpinn.fem.rigid.sourced_stiffness import SourcedStiffness, turning

SACROILIAC_STUDY = (
    "J. Orthop. Res., doi:10.1002/jor.1100050112 (abstract): isolated left joints of eight people, 294 N and 42 N m at "
    "the centre of the sacrum, axes of the end plate of S1"
)
_BETWEEN = (
    f"{SACROILIAC_STUDY}: not told; between the extremes of all directions, which are, their geometric mean"
)
SACROILIAC: tuple[SourcedStiffness, ...] = (
    SourcedStiffness(
        "lateral", 294.0 / 0.76, 294.0 / (0.76 + 1.41), 1000.0,
        f"{SACROILIAC_STUDY}: 0.76 ± 1.41 mm medially; the scatter leaves the upper end of the interval open, 1000 "
        "N/mm stands for it",
    ),
    SourcedStiffness(
        "anterior-posterior", 294.0 / 2.74, 294.0 / (2.74 + 1.07), 294.0 / (2.74 - 1.07),
        f"{SACROILIAC_STUDY}: 2.74 ± 1.07 mm to the front",
    ),
    SourcedStiffness("axial", 294.0 / (0.76 * 2.74) ** 0.5, 294.0 / 2.74, 294.0 / 0.76, _BETWEEN),
    turning("flexion-extension", 42.0 / (1.40 * 6.21) ** 0.5, 42.0 / 6.21, 42.0 / 1.40, _BETWEEN),
    turning(
        "lateral bending", 42.0 / 1.40, 42.0 / (1.40 + 0.71), 42.0 / (1.40 - 0.71),
        f"{SACROILIAC_STUDY}: 1.40 ± 0.71°",
    ),
    turning(
        "torsion", 42.0 / 6.21, 42.0 / (6.21 + 3.29), 42.0 / (6.21 - 3.29), f"{SACROILIAC_STUDY}: 6.21 ± 3.29°",
    ),
)
"""Stiffness of one sacroiliac joint along and about x right, y back, z caudal of the sacrum's upper end plate, at the
middle of the sacrum."""

COSTOVERTEBRAL_STUDY = (
    "Measuring the global mechanical properties of the human thorax: costo-vertebral articulation, J. Biomech. 163, "
    "2024, 111923 (abstract): two bodies, four levels"
)
_PULL = (
    f"{COSTOVERTEBRAL_STUDY}: 28 N over 1.41 mm along the rib, 1.55 mm in sagittal, 1.08 mm in transverse direction; "
    "called almost the same in all, that of the middle"
)
_TWIST = (
    f"{COSTOVERTEBRAL_STUDY}: ± 0.1 N m over a range of 13.2° (6.4° to 20.9°), up and down; taken about all axes"
)
COSTOVERTEBRAL: tuple[SourcedStiffness, ...] = (
    *(SourcedStiffness(name, 28.0 / 1.41, 28.0 / 1.55, 28.0 / 1.08, _PULL) for name in ("x", "y", "z")),
    *(turning(f"about {name}", 0.2 / 13.2, 0.2 / 20.9, 0.2 / 6.4, _TWIST) for name in ("x", "y", "z")),
)
"""Stiffness of the joint of a rib and the vertebra of its number, the same in all directions."""
