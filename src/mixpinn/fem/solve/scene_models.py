"""What a scene is solved with: its contact and its elastic bodies."""

import numpy as np

from mixpinn.fem.contact.faces import FaceContactModel
from mixpinn.fem.contact.model import ContactModel
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.elements.system import ElasticSystem
from mixpinn.fem.scene import Scene
from mixpinn.geometry.probe_surface import ProbeSurface


def contact_model(scene: Scene) -> ContactModel:
    """Contact between the probe and the skin of `scene`.

    Linear elements meet the probe at contact points, as SOFA's do; for quadratic ones the gap law is integrated over
    the faces of the skin.
    """
    skin = scene.skin or SkinSurface.of_mesh(scene.mesh)
    probe = ProbeSurface.of_probe(scene.probe, spacing=scene.contact.spacing)
    if scene.mesh.order == 1:
        return ContactModel(skin, probe, scene.contact)
    faces = skin.surface.triangles
    if scene.skin is None:
        faces = np.searchsorted(skin.nodes[:, 0], scene.mesh.skin_node_faces)
    rest = skin.vertices(scene.mesh.node_points)
    return FaceContactModel.of_faces(skin, faces, rest, probe, scene.contact)


def elastic_system(scene: Scene) -> ElasticSystem:
    """The elastic bodies of `scene`, with its joints, foundations and membrane."""
    return ElasticSystem(
        scene.mesh, scene.materials, threads=scene.solver.threads or 1, joints=scene.joints,
        foundations=scene.foundations, membrane=scene.membrane,
    )
