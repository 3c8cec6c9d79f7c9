"""What a scene is solved with: its contact and its elastic bodies."""

from mixpinn.fem.contact.model import ContactModel
from mixpinn.fem.contact.surfaces import SkinSurface
from mixpinn.fem.elements.system import ElasticSystem
from mixpinn.fem.scene import Scene
from mixpinn.geometry.probe_surface import ProbeSurface


def contact_model(scene: Scene) -> ContactModel:
    """Contact between the probe and the skin of `scene`."""
    skin = scene.skin or SkinSurface.of_mesh(scene.mesh)
    return ContactModel(skin, ProbeSurface.of_probe(scene.probe, spacing=scene.contact.spacing), scene.contact)


def elastic_system(scene: Scene) -> ElasticSystem:
    """The elastic bodies of `scene`."""
    return ElasticSystem(scene.mesh, scene.materials, threads=scene.solver.threads or 1)
