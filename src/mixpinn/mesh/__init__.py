"""Label map to labelled tetrahedral mesh."""

from mixpinn.mesh.import_vtu import import_vtu, load_paper_mesh
from mixpinn.mesh.label import fixed_nodes
from mixpinn.mesh.orientation import check_cells, orient_cells, signed_volumes

__all__ = ["check_cells", "fixed_nodes", "import_vtu", "load_paper_mesh", "orient_cells", "signed_volumes"]
