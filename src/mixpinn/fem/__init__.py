"""Finite elements: material, rigid bodies, contact and the quasi-static solve."""

from mixpinn.fem.contact.model import ContactConfig, ContactModel
from mixpinn.fem.contact.pressure import ContactPressure, contact_area, contact_pressure
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.local_refinement import LocalRefinement
from mixpinn.fem.material.hyperelastic import (
    DEFAULT_TISSUE,
    PAPER_TISSUE,
    LinearElastic,
    Material,
    StableNeoHookean,
    StableNeoHookeanLog,
)
from mixpinn.fem.rigid.joint_presets import JointPreset, preset_joints
from mixpinn.fem.scene import Scene
from mixpinn.fem.scene_record import scene_hash, scene_record
from mixpinn.fem.solve.imposed import ImposedSolution, solve_imposed
from mixpinn.fem.solve.linear import LinearSolver, SuperLUSolver, default_solver
from mixpinn.fem.solve.pardiso import PardisoSolver
from mixpinn.fem.solve.pose import PressHistory, solve_pose
from mixpinn.fem.solve.pose_simulator import PoseSimulator
from mixpinn.fem.solve.quasi_static import QuasiStaticSolver, SolverConfig
from mixpinn.fem.solve.refined_pose import RefinedSimulator, simulate_pose
from mixpinn.fem.solve.scene_models import contact_model, elastic_system
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.joints import JointLaw, LinearBushing, NeutralZoneBushing
from mixpinn.records.joint_frame import JointFrame

__all__ = [
    "DEFAULT_TISSUE", "PAPER_TISSUE", "ContactConfig", "ContactModel", "ContactPressure", "ElasticSystem",
    "ImposedSolution", "Joint", "JointFrame", "JointLaw", "JointPreset", "LinearBushing", "LinearElastic",
    "LinearSolver", "LocalRefinement", "Material", "NeutralZoneBushing", "PardisoSolver", "PoseSimulator",
    "PressHistory", "ProbePose", "QuasiStaticSolver", "RefinedSimulator", "Scene", "SkinSurface", "SolverConfig",
    "StableNeoHookean", "StableNeoHookeanLog", "State", "SuperLUSolver", "contact_area", "contact_model",
    "contact_pressure", "default_solver", "elastic_system", "linear_probe", "preset_joints", "scene_hash",
    "scene_record", "simulate_pose", "solve_imposed", "solve_pose", "spherical_probe",
]
