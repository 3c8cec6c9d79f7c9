"""The predictor against the network itself, its refusals, and what it does not import."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.networks import ModelConfig, build_graph_for, build_model, load_checkpoint
from mixpinn.records import Answer, SampleTable, TissueMesh
from mixpinn.serving import Predictor
from mixpinn.serving.contact_input import checked_contact, spread


@pytest.fixture(scope="module")
def predictor(folder: Path) -> Predictor:
    """The loaded model."""
    return Predictor.load(folder, threads=1)


def test_predictions_are_the_networks(predictor: Predictor, folder: Path, table: SampleTable) -> None:
    model, graph, _ = load_checkpoint(folder)
    field = table.contact_field(2)
    with torch.no_grad():
        expected = model(torch.from_numpy(field)[None])[0].numpy()
    np.testing.assert_array_equal(predictor.predict_with_virtual(*table.contact(2)), expected)
    answer = predictor.predict(*table.contact(2))
    np.testing.assert_array_equal(answer, expected[:125])
    assert (answer.dtype, answer.shape, graph.n_nodes) == (np.float32, (125, 3), 127)
    assert predictor.name == "mixpinn"


def test_the_operand_stays_untouched_and_its_type_does_not_matter(predictor: Predictor, table: SampleTable) -> None:
    nodes, moved = table.contact(0)
    exact = moved.astype(np.float64)
    exact.flags.writeable = False
    np.testing.assert_array_equal(predictor.predict(nodes, exact), predictor.predict(nodes.astype(np.int32), moved))
    zero = np.zeros((len(nodes), 3), dtype=int)
    np.testing.assert_array_equal(predictor.predict(nodes, zero), predictor.predict(nodes, 0.0 * moved))


def test_contact_nodes_may_come_in_any_order(predictor: Predictor, table: SampleTable) -> None:
    sample = table[1]
    expected = predictor.predict(*table.contact(1))
    backwards = predictor.predict_at(sample.contact_nodes[::-1], sample.contact_displacement[::-1])
    assert isinstance(backwards, Answer)
    assert backwards.model == "mixpinn"
    np.testing.assert_array_equal(backwards.displacement, expected)
    assert backwards.force is None
    assert backwards.trust is None


def test_motions_of_a_network_are_the_nearest_rigid_ones(predictor: Predictor, table: SampleTable) -> None:
    mesh, answer = predictor.mesh, predictor.predict_at(*table.contact(1))
    assert set(answer.motions) == set(mesh.rigid_names)
    nodes = mesh.part_nodes(1)
    np.testing.assert_allclose(
        answer.motions[mesh.rigid_names[0]].translation, answer.displacement[nodes].mean(axis=0), atol=1e-6,
    )


def test_a_network_refuses_poses(predictor: Predictor) -> None:
    with pytest.raises(InputError, match="takes the probe's pose"):
        predictor.press((0.0, 0.0, 0.0))


def test_spread_is_the_field_that_networks_read(table: SampleTable) -> None:
    np.testing.assert_array_equal(spread(*table.contact(1), n_nodes=125), table.contact_field(1))


BAD_CONTACTS = {
    "unknown node": ([125], [[0, 0, 0]], "ids from 0 to 124"),
    "negative node": ([-1], [[0, 0, 0]], "ids from 0 to 124"),
    "node twice": ([3, 3], [[0, 0, 0], [0, 0, 1]], "each node once"),
    "no node": ([], np.zeros((0, 3)), "at least one node"),
    "node ids that are no integers": ([1.5], [[0, 0, 0]], "list of at least one node id"),
    "too few displacements": ([1, 2], [[0, 0, 0]], r"shape \(2, 3\)"),
    "two components": ([1], [[0, 0]], r"shape \(1, 3\)"),
    "nan": ([1], [[0, np.nan, 0]], "finite"),
    "beyond any body": ([1], [[0, -1e30, 0]], "at most 1000, got 1e\\+30"),
}


@pytest.mark.parametrize(("nodes", "displacements", "message"), BAD_CONTACTS.values(), ids=BAD_CONTACTS)
def test_bad_contacts_are_refused(nodes: object, displacements: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        checked_contact(np.array(nodes), np.array(displacements), n_nodes=125)


def test_a_mesh_of_another_topology_is_refused(folder: Path, mesh: TissueMesh) -> None:
    moved = TissueMesh(
        mesh.points + 1.0, mesh.cells, mesh.part, mesh.fixed, mesh.rigid_names, mesh.tissue, mesh.tissue_names,
    )
    with pytest.raises(InputError, match=r"a model of linear tetrahedra.* got one of linear tetrahedra"):
        Predictor.load(folder, mesh=moved)
    with pytest.raises(InputError, match="threads"):
        Predictor.load(folder, threads=0)


def test_virtual_topology_is_the_graphs(mesh: TissueMesh) -> None:
    evaluation = pytest.importorskip("mixpinn.evaluation")
    def of(config: ModelConfig) -> object:
        graph = build_graph_for(config, mesh)
        return Predictor(build_model(config, graph), graph, config, mesh, name="model").virtual

    assert of(ModelConfig(layers=1, hidden=2)) is None
    virtual = of(ModelConfig(layers=1, hidden=2, virtual_nodes=True))
    assert isinstance(virtual, evaluation.VirtualTopology)
    np.testing.assert_array_equal(virtual.part, [1, 2])
    np.testing.assert_allclose(virtual.points, [mesh.points[mesh.part == k].mean(axis=0) for k in (1, 2)])
    pairs = {tuple(sorted(edge)) for edge in virtual.edges.tolist()}
    assert pairs == {(int(node), 125 + k - 1) for k in (1, 2) for node in mesh.part_nodes(k)}
    assert len(pairs) == len(virtual.edges)


def test_serving_imports_neither_trainer_nor_solver(folder: Path, tmp_path: Path) -> None:
    script = (
        "import json, sys; import mixpinn as mx; from mixpinn.stages.prediction import answer_contacts\n"
        "answer_contacts(mx.load(sys.argv[1]), sys.argv[2]).save(sys.argv[3])\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    contacts = tmp_path / "contacts.csv"
    contacts.write_text("71,0,-1,0\n72,0,-1,0\n")
    done = subprocess.run(
        [sys.executable, "-c", script, str(folder), str(contacts), str(tmp_path / "out.vtu")], capture_output=True,
        text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, timeout=120,
    )
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout.strip().splitlines()[-1]))
    layers = {f"mixpinn.{name}" for name in ("training", "evaluation", "dataset", "fem", "mesh", "anatomy")}
    assert "mixpinn.networks" in loaded
    assert not loaded & (layers | {"lightning", "ipctk", "pypardiso"})
    assert (tmp_path / "out.vtu").exists()
