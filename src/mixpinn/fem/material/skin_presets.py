"""Presets of the skin as a membrane, each figure with its source and range.

Of all sources the abstracts were read, none of the papers. None gives tension and stiffness of the lumbar back on
living people: the tension was found on arms, the slope on skin cut from the back, the thickness by ultrasound on the
trunk. What is published of skin's modulus lies between 5 kPa and 140 MPa (Mechanical behaviour of skin: a review,
abstract): by default nothing is assumed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from mixpinn.base.errors import InputError
from mixpinn.physics.membrane import Membrane


class SkinPreset(StrEnum):
    """What the skin does besides the tissue under it.

    Attributes:
        NONE: nothing.
        TENSION: it is stretched, which resists bending, as a surface tension does.
        ELASTIC: it is stretched and resists further stretch.
    """

    NONE = "none"
    TENSION = "tension"
    ELASTIC = "elastic"


@dataclass(frozen=True)
class SourcedFigure:
    """A figure of the skin.

    Attributes:
        value: taken.
        low, high: published range.
        unit: of the three.
        source: where it stands, and what was chosen.
    """

    value: float
    low: float
    high: float
    unit: str
    source: str


TENSION = SourcedFigure(
    6.2, 5.6, 11.4, "N/m",
    "C. Flynn, A. Taberner, P. Nielsen, Mechanical characterisation of in vivo human skin using a 3D force-sensitive "
    "micro-robot and finite element analysis (abstract): largest tension in vivo, 6.2 and 11.4 N/m on the front of the "
    "forearm, 5.6 N/m on the back of the upper arm; the middle one",
)
SLOPE = SourcedFigure(
    1.18, 0.30, 2.06, "MPa",
    "A. Ní Annaidh et al., Characterization of the anisotropic mechanical properties of excised human skin, J. Mech. "
    "Behav. Biomed. Mater. 5, 2012, 139-148 (abstract): initial slope of skin from the back, 1.18 ± 0.88 MPa",
)
THICKNESS = SourcedFigure(
    1.476, 0.79, 2.0, "mm",
    "P. Krackowizer, E. Brenner, Dicke der Epidermis und Dermis, Phlebologie 37, 2008, 83-92 (abstract): ultrasound on "
    "112 people, 0.79 mm on the foot to 1.476 mm on the thorax on average; that of the thorax",
)

MEMBRANES: Mapping[SkinPreset, Membrane | None] = {
    SkinPreset.NONE: None,
    SkinPreset.TENSION: Membrane(tension=1e-3 * TENSION.value),
    SkinPreset.ELASTIC: Membrane(shear=SLOPE.value * THICKNESS.value / 3.0, tension=1e-3 * TENSION.value),
}
"""Membranes by preset: γ, and μh = E h / 3 of an incompressible sheet."""


def preset_of(membrane: Membrane | None) -> SkinPreset:
    """The preset that gives a membrane.

    Raises:
        InputError: none does.
    """
    for preset, known in MEMBRANES.items():
        if membrane == known:
            return preset
    raise InputError(
        "further simulations with the settings of a store", expected="a membrane that settings can name",
        got="one of your own", fix="simulate them with a scene in Python (mixpinn.simulate)",
    )
