"""Label map to labelled tetrahedral mesh."""

from mixpinn.mesh.cells.bisect import refine_to
from mixpinn.mesh.cells.label import FixedRegion, PartContacts, fixed_nodes, label_mesh, part_contacts
from mixpinn.mesh.cells.orientation import check_cells, orient_cells
from mixpinn.mesh.cells.refine import refine
from mixpinn.mesh.checks.fidelity import MeshFidelity, StructureFidelity, mesh_fidelity, voxel_parts
from mixpinn.mesh.checks.quality import MeshQuality, dihedral_angles, mesh_quality, radius_ratios
from mixpinn.mesh.checks.statistics import MeshStatistics, PartStatistics, mesh_statistics
from mixpinn.mesh.import_vtu import import_vtu, load_paper_mesh
from mixpinn.mesh.joint_frames import joint_frames
from mixpinn.mesh.joint_picture import draw_joint_frames
from mixpinn.mesh.meshers.cgal_mesher import CgalMesher
from mixpinn.mesh.meshers.grading import Grading, SizingField
from mixpinn.mesh.meshers.mesher import PAPER_SIZING, Mesher, Sizing, has_cgal
from mixpinn.mesh.meshers.tetwild_mesher import TetwildMesher
from mixpinn.mesh.picture import draw_mesh
from mixpinn.mesh.surfaces.check_surface import check_surface, check_surfaces, self_intersections
from mixpinn.mesh.surfaces.extract import SurfaceConfig, extract_surfaces
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface

__all__ = [
    "PAPER_SIZING", "CgalMesher", "DomainSurfaces", "FixedRegion", "Grading", "MeshFidelity", "MeshQuality",
    "MeshStatistics", "Mesher", "PartContacts", "PartStatistics", "Sizing", "SizingField", "StructureFidelity",
    "Surface", "SurfaceConfig", "TetwildMesher", "check_cells", "check_surface", "check_surfaces", "dihedral_angles",
    "draw_joint_frames", "draw_mesh", "extract_surfaces", "fixed_nodes", "has_cgal", "import_vtu", "joint_frames",
    "label_mesh", "load_paper_mesh", "mesh_fidelity", "mesh_quality", "mesh_statistics", "orient_cells",
    "part_contacts", "radius_ratios", "refine", "refine_to", "self_intersections", "voxel_parts",
]
