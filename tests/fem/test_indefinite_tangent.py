"""A press under which tissue is about to buckle: the tangent of its last step is indefinite at every iteration."""

from dataclasses import replace

import pytest

from mixpinn.dataset import probe_path
from mixpinn.dataset.protocol import ANATOMY
from mixpinn.fem import LocalRefinement, PoseSimulator
from mixpinn.fem.local_refinement import refine_under
from mixpinn.pipeline.onboarding import OnboardingConfig
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.mesh import make_mesh
from mixpinn.stages.simulation import for_patients, make_scene

POSITION = (13.302416854994199, 124.47145141534622, 21.249737000000003)


def test_its_last_step_converges_without_a_factorization_an_iteration(shared_data, drill) -> None:
    if not drill:
        pytest.skip("only in 'make drill': a patient's mesh and twenty steps on 26,000 nodes")
    folder = shared_data / "patient2" / "segmentations"
    if not folder.is_dir():
        pytest.skip("no second patient among the data")
    label_map = make_anatomy(AnatomyConfig(source="folder", path=str(folder))).label_map
    config = OnboardingConfig()
    mesh = make_mesh(label_map, config.mesh).mesh
    scene = make_scene(mesh, for_patients(config.simulation, label_map.soft_names))
    path = probe_path(POSITION, 0.0, ANATOMY)
    fine = refine_under(mesh, scene.probe, path, LocalRefinement())
    simulator = PoseSimulator(replace(scene, mesh=fine, refinement=None))
    found = simulator.run(path)
    assert found.converged.all()
    assert found.residual.max() <= scene.solver.tolerance
    assert simulator.solver.effort.factorizations < 40
