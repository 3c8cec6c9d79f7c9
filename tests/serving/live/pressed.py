"""A toy bundle that takes poses, for live sessions: the block under a sphere."""

from pathlib import Path

import numpy as np

from mixpinn.fem import SuperLUSolver
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import save_pose_model
from mixpinn.press.model import PoseModel
from mixpinn.records import MESH_FILE
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import HybridPredictor
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

UP = 40.0
"""Height of the block's top [mm]."""


def block_predictor() -> HybridPredictor:
    """The prior of the block, with contact from the pose of a sphere."""
    mesh = block_mesh()
    prior = ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    size, rows = prior.coordinates.size, 3 * len(prior.nodes)
    newton = ModalNewton(
        prior, Equilibrium.of_materials(mesh, [TISSUE]), Rows.of(np.zeros((2, size))),
        Rows.of(np.zeros((2, size))), np.zeros((2, rows), np.float32),
    )
    readers = np.random.default_rng(0).normal(size=(4, rows)).astype(np.float32)
    hybrid = HybridModel(newton, readers, np.zeros((2 + 4 + 10, 2), np.float32))
    contact = PriorContact.of_prior(prior)
    probe = contact.field(spherical_probe(radius=12.0, subdivisions=3))
    return HybridPredictor(hybrid, pose=PoseModel(hybrid, contact, (probe,), PoseDomain.of_mesh(mesh)))


def save_bundle(predictor: HybridPredictor, folder: Path) -> Path:
    """The folder, in which the predictor now lies as a bundle that takes poses."""
    assert predictor.pose is not None
    predictor.mesh.save(folder / MESH_FILE)
    predictor.model.save(folder)
    save_pose_model(predictor.pose, folder)
    return folder



def above(x: float = 18.0, z: float = 22.0, depth: float = 3.0) -> ProbePose:
    """The sphere, `depth` beyond first touch of the block's top."""
    return ProbePose(np.eye(3), np.array([x, UP + 2.0 - depth, z]))
