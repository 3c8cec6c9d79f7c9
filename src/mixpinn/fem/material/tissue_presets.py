"""Presets of the moduli of soft tissues by name, each with its source and range.

What is published differs tenfold between methods, and so there are two presets instead of one truth: ``compression``,
slopes of stress over strain under a probe, as this project presses; and ``elastography``, three times the shear moduli
of shear waves. Of the sources the abstracts were read, of one a table, and none of the papers as a whole; the ranges
are those of people, one standard deviation, or of sources. Poisson's ratio is that of the default tissue, 0.45: what
is nearly incompressible in the body is made a little softer in bulk, as in the paper.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from mixpinn.anatomy.names import tissue_group
from mixpinn.fem.material.hyperelastic import Material, StableNeoHookean

POISSON = 0.45

ISOGAI = (
    "K. Isogai et al., Young's moduli of subcutaneous tissues and muscles under different loads at the gluteal region, "
    "J. Phys. Ther. Sci. 34, 2022, 777-783 (abstract)"
)
HATT = (
    "A. Hatt, R. Lloyd, B. Bolsterlee, L. E. Bilston, Strain-dependent shear properties of human adipose tissue in "
    "vivo, J. Mech. Behav. Biomed. Mater. 2023, 105924 (abstract)"
)
THEN = "C. Then et al., Method for characterizing viscoelasticity of human gluteal tissue (abstract)"
SADEGHI = (
    "S. Sadeghi, J. E. Bible, D. H. Cortes, Quantifying dysfunction of the lumbar multifidus muscle, 2020, "
    "doi:10.1115/1.4047651 (abstract)"
)
VICECONTI = (
    "N. Viceconti et al., Shear wave elastography in healthy patients, World J. Radiol. 17, 2025, "
    "doi:10.4329/wjr.v17.i11.111651 (abstract)"
)
DISC_TABLE = "table 1 of doi:10.1111/os.12344 (PMC6584379), a finite-element model of the thorax (the table was read)"


class TissuePreset(StrEnum):
    """Which moduli tissues have that are known by name.

    Attributes:
        NONE: those of the default tissue, all alike.
        COMPRESSION: slopes under a probe.
        ELASTOGRAPHY: from shear waves.
    """

    NONE = "none"
    COMPRESSION = "compression"
    ELASTOGRAPHY = "elastography"


@dataclass(frozen=True)
class SourcedModulus:
    """Young's modulus of a tissue.

    Attributes:
        value: taken [kPa].
        low, high: published range [kPa].
        source: where it stands, and what was chosen.
    """

    value: float
    low: float
    high: float
    source: str

    def material(self) -> Material:
        """Stable Neo-Hookean of this modulus."""
        return StableNeoHookean.from_young(self.value * 1e-3, POISSON)


_ORGAN = SourcedModulus(
    5.0, 3.9, 23.0, f"{VICECONTI}: liver 3.9-4.7, pancreas 5.2-7.6, spleen 19.4-23.0 kPa; one value for all organs",
)
_DISC = SourcedModulus(9200.0, 3500.0, 14900.0, f"{DISC_TABLE}: 3.5-14.9 MPa; the middle")

MODULI: Mapping[TissuePreset, Mapping[str, SourcedModulus]] = {
    TissuePreset.NONE: {},
    TissuePreset.COMPRESSION: {
        "fat": SourcedModulus(26.1, 7.1, 45.1, f"{ISOGAI}: 26.1 ± 19.0 kPa at 1 N; 2.2 MPa at 30 N is left out"),
        "muscle": SourcedModulus(
            62.2, 51.9, 72.5, f"{ISOGAI}: 62.2 ± 10.3 kPa at 5 N; three times the prone multifidus' shear modulus of "
            f"18.6 kPa is 56 kPa ({SADEGHI})",
        ),
        "organ": _ORGAN, "disc": _DISC,
    },
    TissuePreset.ELASTOGRAPHY: {
        "fat": SourcedModulus(2.3, 2.3, 5.6, f"{HATT}: shear modulus 752 Pa at rest; {THEN}: 1850 Pa for skin and fat"),
        "muscle": SourcedModulus(3.0, 2.6, 56.0, f"{HATT}: 1000 Pa, passive; {THEN}: 881 Pa; {SADEGHI}: 18.6 kPa"),
        "organ": _ORGAN, "disc": _DISC,
    },
}
"""Young's moduli by preset and group of tissues (`mixpinn.anatomy.names.tissue_group`)."""


def preset_modulus(name: str, preset: TissuePreset | str) -> SourcedModulus | None:
    """The modulus of the tissue called `name`; None where the preset has none, as for the body."""
    group = tissue_group(name)
    return None if group is None else MODULI[TissuePreset(preset)].get(group)
