"""Scene: everything that one simulated pose depends on, but for the pose itself."""

from dataclasses import dataclass, field, replace

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.fem.contact.model import ContactConfig
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.local_refinement import LocalRefinement
from mixpinn.fem.material.hyperelastic import DEFAULT_TISSUE, Material
from mixpinn.fem.rigid.joint_presets import JointPreset, preset_joints, with_figures
from mixpinn.fem.scene_record import scene_hash, scene_record
from mixpinn.fem.solve.quasi_static import SolverConfig
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.mesh.joint_frames import joint_frames, neighbours
from mixpinn.physics.foundation import Foundation
from mixpinn.physics.joint_system import Joint, JointSystem
from mixpinn.physics.membrane import Membrane
from mixpinn.physics.restraints import Restraints
from mixpinn.records import Probe, TissueMesh


@dataclass(frozen=True, eq=False)
class Scene:
    """Anatomy, tissue, tool and numerics.

    Attributes:
        mesh: soft tissue with rigid parts as cavities.
        probe: the rigid tool; by default the built-in linear probe.
        materials: one for each of the mesh's tissues; by default `DEFAULT_TISSUE` for each.
        contact: gap, friction and stiffness of contact.
        solver: tolerances and limits.
        skin: the surface that the probe can touch; None for the mesh's own skin.
        joints: between rigid parts; by default none, and the parts float in the tissue (`joined` sets a preset's).
        foundations: under the skin; by default none, and the mesh's fixed nodes hold the body.
        membrane: of the skin; by default none.
        refinement: of the cells under the probe, for each pose anew, with the order of the tool where it gives none;
            None solves every pose on the mesh as it is.
    """

    mesh: TissueMesh
    probe: Probe = field(default_factory=linear_probe)
    materials: tuple[Material, ...] = ()
    contact: ContactConfig = field(default_factory=ContactConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    skin: SkinSurface | None = None
    joints: tuple[Joint, ...] = ()
    foundations: tuple[Foundation, ...] = ()
    membrane: Membrane | None = None
    refinement: LocalRefinement | None = None

    def __post_init__(self) -> None:
        if not self.materials:
            object.__setattr__(self, "materials", (DEFAULT_TISSUE,) * len(self.mesh.tissue_names))
        if len(self.materials) != len(self.mesh.tissue_names):
            raise InputError(
                "scene", expected=f"one material for each tissue: {', '.join(self.mesh.tissue_names)}",
                got=f"{len(self.materials)}", fix="pass as many materials as the mesh has tissues",
            )

        if self.refinement is not None and self.skin is not None:
            raise InputError(
                "scene", expected="the mesh's own skin where cells are refined under the probe", got="another surface",
                fix="leave the skin or the refinement out",
            )
        if self.refinement is not None:
            object.__setattr__(self, "refinement", self.refinement.of_tool(self.probe))
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "foundations", tuple(self.foundations))
        discs = [name for name in self.mesh.tissue_names if "disc" in name.lower()]
        if self.joints and discs:
            raise InputError(
                "scene", expected="discs as a tissue, or joints between the vertebrae", got=f"both: {', '.join(discs)}",
                fix="leave the joints out, or label the discs as the tissue around them: together they count twice",
            )
        JointSystem(self.joints, self.mesh.rigid_names, np.zeros((self.mesh.n_parts, 3)))  # refuses unknown parts

    def joined(self, preset: JointPreset | str) -> "Scene":
        """The scene with a preset's joints at the frames that the anatomy of the mesh gives.

        Raises:
            InputError: an unknown preset, no end plates where frames are sought, or discs labelled as a tissue.
        """
        pairs = [] if preset == JointPreset.NONE else [pair for pair in neighbours(self.mesh) if with_figures(*pair)]
        return replace(self, joints=preset_joints(joint_frames(self.mesh, between=pairs), preset))

    @property
    def restraints(self) -> Restraints:
        """Joints, foundations and membrane."""
        return Restraints(self.joints, self.foundations, self.membrane)

    def hash(self) -> str:
        """Identity of all that decides the result; thread counts do not."""
        return scene_hash(scene_record(self), self.mesh.hash())
