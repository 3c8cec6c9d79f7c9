"""The scene that does not move, ready to be sent: a description and the surfaces of skin, rigid parts and probe."""

import colorsys
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, IntArray
from mixpinn.records import TissueMesh
from mixpinn.server.protocol import VERSION, encode_surface, encode_tissue
from mixpinn.serving.hybrid_predictor import HybridPredictor

JSON_TYPE, BINARY_TYPE = "application/json", "application/octet-stream"


@dataclass(frozen=True, eq=False)
class SceneFiles:
    """What is sent to every client alike.

    Attributes:
        files: content type and bytes by path.
        skin_nodes: nodes of the mesh that are vertices of the skin, ascending, shape (v,).
    """

    files: Mapping[str, tuple[str, bytes]]
    skin_nodes: IntArray

    @staticmethod
    def of_predictor(predictor: HybridPredictor) -> "SceneFiles":
        """The scene of a bundle that takes poses.

        Raises:
            InputError: a bundle without contact from the pose.
        """
        mesh, model = predictor.mesh, predictor.pressing
        files: dict[str, tuple[str, bytes]] = {}
        nodes = np.unique(mesh.skin_triangles).astype(np.int64)
        skin = np.searchsorted(nodes, mesh.skin_triangles)
        files["/api/skin.bin"] = BINARY_TYPE, encode_surface(mesh.node_points[nodes], skin, nodes)
        tissue = mesh.deforming_cells
        files["/api/tissue.bin"] = BINARY_TYPE, encode_tissue(mesh.points, mesh.cells[tissue], mesh.tissue[tissue])
        parts = []
        for k, name in enumerate(mesh.rigid_names):
            url = f"/api/parts/{k}.bin"
            files[url] = BINARY_TYPE, _part_surface(mesh, k + 1)
            parts.append({
                "name": name, "label": name.removeprefix("vertebrae_").replace("_", " "),
                "colour": part_colour(k, mesh.n_parts), "url": url,
                "centroid": mesh.points[mesh.part_nodes(k + 1)].mean(axis=0).tolist(),
            })
        probe = model.probes[0].probe
        files["/api/probes/0.bin"] = BINARY_TYPE, encode_surface(probe.points, probe.triangles)
        domain, points = model.domain, mesh.node_points[nodes]
        about: dict[str, Any] = {
            "version": VERSION, "name": predictor.name, "units": {"length": "mm", "force": "N", "moment": "N mm"},
            "frame": {"x": "patient right", "y": "posterior", "z": "caudal"},
            "discretisation": model.hybrid.made_on, "n_nodes": mesh.n_nodes, "n_vertices": len(nodes),
            "low": points.min(axis=0).tolist(), "high": points.max(axis=0).tolist(), "parts": parts,
            "probes": [{
                "name": "probe", "url": "/api/probes/0.bin", "low": probe.points.min(axis=0).tolist(),
                "high": probe.points.max(axis=0).tolist(),
            }],
            "skin": {"url": "/api/skin.bin"},
            "tissue": {"url": "/api/tissue.bin", "names": list(mesh.tissue_names)}, "range": domain.as_dict(),
            "total_error": None if predictor.total is None else asdict(predictor.total),
            "bound_level": model.error.level if model.error is not None else None,
            "warnings": list(bundle_warnings(predictor)), "world_to_scanner": mesh.world_to_scanner.tolist(),
        }
        files["/api/scene.json"] = JSON_TYPE, json.dumps(about, allow_nan=False).encode()
        return SceneFiles(files, nodes)


def bundle_warnings(predictor: HybridPredictor) -> tuple[str, ...]:
    """What speaks against a bundle as a whole, in words."""
    model, about = predictor.pressing, predictor.model.about
    found = []
    if model.error is None:
        found.append("the bundle is not calibrated: its errors are not known")
    if model.correction is None:
        found.append("nothing was learned about contact: forces and fields are those of physics alone")
    positions = about.get("training_positions")
    if isinstance(positions, int) and positions < 10:
        found.append(f"learned from {positions} positions only")
    return tuple(found)


def part_colour(k: int, count: int) -> str:
    """A colour of part k of `count`, ``#rrggbb``: hues as far apart as can be."""
    red, green, blue = colorsys.hsv_to_rgb((0.58 + k / max(count, 1)) % 1.0, 0.42, 0.86)
    return f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"


def _part_surface(mesh: TissueMesh, part: int) -> bytes:
    """A rigid part's surface, outward: its cavity turned inside out, or that of its cells where it is meshed.

    Around a cavity single cells may have all their nodes on it: a part is meshed where most of its nodes lie inside.
    """
    faces = mesh.boundary_faces[:, ::-1]
    own: AnyArray = faces[(mesh.part[faces] == part).all(axis=1)]
    solid = (mesh.part[mesh.cells] == part).all(axis=1)
    if solid.any() and 2 * len(np.unique(own)) < len(mesh.part_nodes(part)):
        faces = replace(mesh, cells=mesh.cells[solid]).boundary_faces
        own = faces[(mesh.part[faces] == part).all(axis=1)]
    nodes = np.unique(own)
    return encode_surface(mesh.points[nodes], np.searchsorted(nodes, own), nodes)
