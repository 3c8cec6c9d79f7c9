"""Scene: everything that one simulated pose depends on, but for the pose itself."""

from dataclasses import dataclass, field, replace

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.fem.contact.model import ContactConfig, ContactModel
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.elements.system import ElasticSystem
from mixpinn.fem.material.hyperelastic import PAPER_TISSUE, Material
from mixpinn.fem.solve.quasi_static import SolverConfig
from mixpinn.geometry.probe_surface import ProbeSurface
from mixpinn.records import Probe, TissueMesh


@dataclass(frozen=True, eq=False)
class Scene:
    """Anatomy, tissue, tool and numerics.

    Attributes:
        mesh: soft tissue with rigid parts as cavities.
        probe: the rigid tool.
        materials: one for each of the mesh's tissues.
        contact: gap, friction and stiffness of contact.
        solver: tolerances and limits.
        skin: the surface that the probe can touch; None for the mesh's own skin.
    """

    mesh: TissueMesh
    probe: Probe
    materials: tuple[Material, ...] = (PAPER_TISSUE,)
    contact: ContactConfig = field(default_factory=ContactConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    skin: SkinSurface | None = None

    def __post_init__(self) -> None:
        if len(self.materials) != len(self.mesh.tissue_names):
            raise InputError(
                "scene", expected=f"one material for each tissue: {', '.join(self.mesh.tissue_names)}",
                got=f"{len(self.materials)}", fix="pass as many materials as the mesh has tissues",
            )

    def hash(self) -> str:
        """Identity of all that decides the result; thread counts do not."""
        numerics = replace(self.solver, threads=None)
        text = f"{self.materials!r}{self.contact!r}{numerics!r}{self.mesh.hash()}{self.probe.hash()}"
        skin = () if self.skin is None else (self.skin.nodes, self.skin.weights, self.skin.surface.triangles)
        return hash_arrays(np.frombuffer(text.encode(), dtype=np.uint8), *skin)

    def contact_model(self) -> ContactModel:
        """Contact between the scene's probe and skin."""
        skin = self.skin or SkinSurface.of_mesh(self.mesh)
        return ContactModel(skin, ProbeSurface.of_probe(self.probe, spacing=self.contact.spacing), self.contact)

    def elastic_system(self) -> ElasticSystem:
        """The elastic bodies."""
        return ElasticSystem(self.mesh, self.materials, threads=self.solver.threads or 1)
