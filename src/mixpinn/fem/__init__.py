"""Finite elements: material, rigid bodies, contact and the quasi-static solve."""

from mixpinn.fem.contact import ContactConfig, ContactModel, ProbePose
from mixpinn.fem.contact_pressure import ContactPressure, contact_area, contact_pressure
from mixpinn.fem.contact_surface import ProbeSurface, SkinSurface
from mixpinn.fem.imposed import ImposedSolution, solve_imposed
from mixpinn.fem.linear import LinearSolver, PardisoSolver, SuperLUSolver, default_solver
from mixpinn.fem.material import PAPER_TISSUE, LinearElastic, Material, StableNeoHookean, StableNeoHookeanLog
from mixpinn.fem.probe_shapes import linear_probe, spherical_probe
from mixpinn.fem.scene import Scene
from mixpinn.fem.simulate import PoseSimulator, simulate_pose
from mixpinn.fem.solve import QuasiStaticSolver, SolverConfig
from mixpinn.fem.system import ElasticSystem, State

__all__ = [
    "PAPER_TISSUE", "ContactConfig", "ContactModel", "ContactPressure", "ElasticSystem", "ImposedSolution",
    "LinearElastic", "LinearSolver", "Material", "PardisoSolver", "PoseSimulator", "ProbePose", "ProbeSurface",
    "QuasiStaticSolver", "Scene", "SkinSurface", "SolverConfig", "StableNeoHookean", "StableNeoHookeanLog", "State",
    "SuperLUSolver", "contact_area", "contact_pressure", "default_solver", "linear_probe", "simulate_pose",
    "solve_imposed", "spherical_probe",
]
