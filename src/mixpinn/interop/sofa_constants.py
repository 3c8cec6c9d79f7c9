"""What recordings of SOFA were made with: a recording holds fields and forces, but neither tissue nor contact."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mixpinn.base.checksum import without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.fem import PAPER_TISSUE, Material, StableNeoHookean
from mixpinn.records.plain import plain

PARAMETERS = "parameters.json"


@dataclass(frozen=True)
class SofaTissue:
    """Parameters of SOFA's Stable Neo-Hookean.

    Attributes:
        mu, lam: μ and λ [kPa].
    """

    mu: float
    lam: float

    def material(self) -> Material:
        """The material in N/mm²."""
        return StableNeoHookean(mu=self.mu * 1e-3, lam=self.lam * 1e-3)


@dataclass(frozen=True)
class SofaContact:
    """Contact of a SOFA scene.

    Attributes:
        gap: contact distance [mm].
        alarm: alarm distance [mm].
        friction: Coulomb's coefficient.
    """

    gap: float
    alarm: float
    friction: float


@dataclass(frozen=True)
class SofaConstants:
    """What a scene of SOFA was run with; what is not said is refused, not guessed.

    Attributes:
        tissue: of all soft tissue that `tissues` does not name.
        tissues: by name of the mesh's tissue.
        contact: gap, alarm distance and friction.
    """

    tissue: SofaTissue | None = None
    tissues: dict[str, SofaTissue] = field(default_factory=dict)
    contact: SofaContact | None = None

    @staticmethod
    def of_scene(folder: Path | str) -> "SofaConstants":
        """The constants of a scene that `export_sofa_scene` wrote, from its ``parameters.json``.

        Raises:
            InputError: no such scene, or a damaged one.
        """
        path = Path(folder) / PARAMETERS
        remake = "export the scene again, or leave 'sha256' out if you changed it on purpose"
        written = without_checksum(read_json(path), str(path), remake=remake)
        try:
            names, mu, lam = written["tissue_names"], written["mu"], written["lam"]
            tissues = {
                str(name): SofaTissue(1e3 * float(a), 1e3 * float(b)) for name, a, b in zip(names, mu, lam, strict=True)
            }
            contact = SofaContact(float(written["gap"]), float(written["alarm"]), float(written["friction"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                str(path), expected="the parameters of an exported scene", got=repr(error),
                fix="export the scene again",
            ) from error
        return SofaConstants(tissues=tissues, contact=contact)

    def record(self, tissue_names: Sequence[str]) -> dict[str, Any]:
        """The record of the scene, as `mixpinn.fem.scene_record` makes it for our own.

        Raises:
            InputError: a tissue of the mesh without constants, or contact unknown.
        """
        chosen = {name: self.tissues.get(name, self.tissue) for name in tissue_names}
        silent = [f"tissue {name!r}" for name, tissue in chosen.items() if tissue is None]
        silent += ["contact"] if self.contact is None else []
        if silent:
            raise InputError(
                "recordings of SOFA", expected="tissue constants and contact that they were made with",
                got=f"nothing about {', '.join(silent)}",
                fix="give --paper-constants, the exported scene with --scene FOLDER, or tissue.mu, tissue.lam, "
                    "contact.gap, contact.alarm and contact.friction with --set",
            )
        unknown = sorted(set(self.tissues) - set(tissue_names))
        if unknown:
            raise InputError(
                f"tissue {unknown[0]!r}", expected="one of " + ", ".join(tissue_names), got="another name",
                fix="name a tissue of the mesh",
            )
        return {
            "simulator": "SOFA",
            "materials": [plain(tissue.material()) for tissue in chosen.values() if tissue is not None],
            "contact": plain(self.contact),
        }


PAPER_SOFA = SofaConstants(
    tissue=SofaTissue(mu=1e3 * PAPER_TISSUE.mu, lam=1e3 * PAPER_TISSUE.lam),
    contact=SofaContact(gap=2.0, alarm=4.0, friction=1.0),
)
"""The constants of the paper's scene."""
