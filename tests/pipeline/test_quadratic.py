"""Ten-node cells from simulation to answer: store, samples, hybrid bundle, prediction, trust, refinement, network."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fem.block_mesh import carved, labelled, two_bones
from mixpinn.base.errors import InputError
from mixpinn.dataset import Protocol, SimulationStore, Split, build_sample_table, generate, grid_positions, plan_poses
from mixpinn.evaluation import ZeroModel, evaluate
from mixpinn.fem import Scene, SolverConfig, StableNeoHookean, scene_record
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.graph import build_graph
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.serving import HybridPredictor
from mixpinn.serving.contact_source import SampleAddress
from mixpinn.stages.evaluation import EvaluationConfig, evaluate_models
from mixpinn.stages.hybrid import HybridStageConfig, make_hybrid
from mixpinn.stages.prediction import answer_contacts
from mixpinn.training import batches


@pytest.fixture(scope="module")
def mesh():
    carved_block = carved(two_bones())
    fixed = (carved_block.points[:, 1] < 1e-9) & (carved_block.part == 0)
    return labelled(
        carved_block.points, carved_block.cells, part=carved_block.part, fixed=fixed,
    ).with_order(2)


@pytest.fixture(scope="module")
def store(mesh, tmp_path_factory):
    protocol = Protocol(
        rotations=(0.0,), approach=0.5, step=1.0, steps=3, start="touch", spacing=10.0, max_positions=4,
    )
    probe = spherical_probe(radius=8.0, subdivisions=2)
    scene = Scene(mesh, probe, (StableNeoHookean.from_young(25.4e-3, 0.45),), solver=SolverConfig(threads=1))
    positions = grid_positions(mesh, protocol)
    store = SimulationStore.create(
        tmp_path_factory.mktemp("store"), mesh, protocol=protocol, positions=positions,
        poses=plan_poses(positions, protocol, mesh=mesh, probe=probe, gap=scene.contact.gap),
        scene=scene_record(scene), probe=probe,
    )
    generate(scene, store.poses, store, workers=1)
    return store


@pytest.fixture(scope="module")
def table(store):
    return build_sample_table(store)


@pytest.fixture(scope="module")
def bundle(store, table, tmp_path_factory):
    out = tmp_path_factory.mktemp("bundle") / "hybrid"
    seen = np.unique(table.position_index)
    make_hybrid(
        store, table, Split("toy", seen[:-2], seen[-2:-1], seen[-1:]),
        HybridStageConfig(HybridConfig(modes=6, coordinates=3)), out=out,
    )
    return out


def test_samples_have_all_nodes_and_networks_their_vertices(mesh, table):
    assert table.displacement.shape[1] == mesh.n_nodes
    assert (table.contact_nodes >= mesh.n_points).any()
    seen = table.on_vertices(mesh.n_points)
    assert seen.contact_nodes.max() < mesh.n_points
    for i in range(len(table)):
        assert_array_equal(seen.contact_field(i), table.contact_field(i)[: mesh.n_points])
    batch = next(iter(batches(table, build_graph(mesh), batch_size=2)))
    assert batch.target.shape == batch.contact_displacement.shape == (2, mesh.n_points, 3)


def test_the_bundle_predicts_assesses_presses_and_refines(mesh, table, bundle, tmp_path):
    predictor = HybridPredictor.load(bundle)
    sample = table[len(table) - 1]
    found = predictor.predict_at(sample.contact_nodes, sample.contact_displacement, reference=sample.displacement)
    size = np.linalg.norm(sample.displacement[: mesh.n_points], axis=1).mean()
    missed = found.displacement - sample.displacement[: len(found.displacement)]
    assert np.linalg.norm(missed, axis=1).mean() < 0.1 * size
    found.save(tmp_path / "deformed.vtu")
    assert predictor.assess(sample.contact_nodes, sample.contact_displacement).expected > 0.0
    pressed = predictor.press(table.probe_translation[-1])
    assert pressed.force[1] > 0.0
    refined, history = predictor.refine(sample.contact_nodes, sample.contact_displacement, 4)
    assert history[-1] < 1e-8
    assert_allclose(refined.displacement, sample.displacement, atol=5e-4)


def test_errors_are_those_of_the_vertices(mesh, table, bundle):
    found = evaluate(HybridPredictor.load(bundle), table, mesh, split="all")
    still = evaluate(ZeroModel(mesh.n_points), table, mesh, split="all")
    assert found.metrics["mee"].mean() < 0.1 * still.metrics["mee"].mean()
    moved = np.linalg.norm(table.displacement[0, : mesh.n_points], axis=1).mean()
    assert still.metrics["mee"][0] == pytest.approx(moved, rel=1e-5)
    assert found.metrics["ree"].max() < 1e-5


def test_bundles_and_samples_of_the_linear_cells_are_refused(mesh, table, bundle):
    with pytest.raises(InputError, match="mesh"):
        HybridModel.load(bundle, mesh.with_order(1))
    with pytest.raises(InputError, match="mesh"):
        evaluate(ZeroModel(mesh.n_points), table, mesh.with_order(1), split="all")


@pytest.fixture(scope="module")
def linear_store(store, mesh, tmp_path_factory):
    """The same poses on the linear cells of the same mesh, not simulated yet."""
    return SimulationStore.create(
        tmp_path_factory.mktemp("linear") / "store", mesh.with_order(1), protocol=store.protocol,
        positions=store.positions, poses=store.poses, scene=store.scene, probe=store.probe(),
    )


def test_predicting_a_sample_of_linear_cells_names_both_discretisations(bundle, linear_store):
    address = SampleAddress(linear_store.folder, 0, 0.0)
    with pytest.raises(InputError, match=r"model's quadratic tetrahedra.* got those of linear tetrahedra"):
        answer_contacts(HybridPredictor.load(bundle, warm_up=False), address)


def test_evaluating_on_simulations_of_linear_cells_names_both_discretisations(bundle, linear_store, table, tmp_path):
    seen = np.unique(table.position_index)
    with pytest.raises(InputError, match=r"a model of linear tetrahedra.* got one of quadratic tetrahedra"):
        evaluate_models(
            linear_store, table, Split("toy", seen[:-2], seen[-2:-1], seen[-1:]), [bundle],
            EvaluationConfig(prior=False), out=tmp_path / "out",
        )


def test_fitting_on_simulations_of_linear_cells_names_both_discretisations(mesh, bundle, store, table):
    model = HybridPredictor.load(bundle, warm_up=False).model
    others = replace(table, mesh_hash=mesh.with_order(1).hash(), discretisation=discretisation_of(mesh.with_order(1)))
    with pytest.raises(InputError, match=r"samples of quadratic tetrahedra.* got those of linear tetrahedra"):
        fit_hybrid(model.prior, store.materials(), others, others.select([]))
