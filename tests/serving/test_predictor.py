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
from mixpinn.records import Prediction, SampleTable, TissueMesh
from mixpinn.serving import Predictor, contact_field


@pytest.fixture(scope="module")
def predictor(folder: Path) -> Predictor:
    """The loaded model."""
    return Predictor.load(folder, threads=1)


def test_predictions_are_the_networks(predictor: Predictor, folder: Path, table: SampleTable) -> None:
    model, graph, _ = load_checkpoint(folder)
    field = table.contact_field(2)
    with torch.no_grad():
        expected = model(torch.from_numpy(field)[None])[0].numpy()
    np.testing.assert_array_equal(predictor.predict_with_virtual(field), expected)
    answer = predictor.predict(field)
    np.testing.assert_array_equal(answer, expected[:125])
    assert (answer.dtype, answer.shape, graph.n_nodes) == (np.float32, (125, 3), 127)
    assert predictor.name == "mixpinn"


def test_the_operand_stays_untouched_and_its_type_does_not_matter(predictor: Predictor, table: SampleTable) -> None:
    field = table.contact_field(0).astype(np.float64)
    field.flags.writeable = False
    np.testing.assert_array_equal(predictor.predict(field), predictor.predict(field.astype(np.float32)))
    np.testing.assert_array_equal(predictor.predict(np.zeros((125, 3), dtype=int)), predictor.predict(0.0 * field))


def test_a_list_of_contacts_in_any_order_is_the_field(predictor: Predictor, table: SampleTable) -> None:
    sample = table[1]
    expected = predictor.predict(table.contact_field(1))
    backwards = predictor.predict_at(sample.contact_nodes[::-1], sample.contact_displacement[::-1])
    assert isinstance(backwards, Prediction)
    assert backwards.model == "mixpinn"
    np.testing.assert_array_equal(backwards.displacement, expected)


BAD_FIELDS = {
    "other mesh": np.zeros((124, 3)), "flat": np.zeros(375), "a batch": np.zeros((1, 125, 3)),
    "nan": np.full((125, 3), np.nan), "infinite": np.full((125, 3), np.inf), "too large": np.full((125, 3), 1e300),
    "text": np.full((125, 3), "a"), "complex": np.zeros((125, 3), dtype=complex),
}


@pytest.mark.parametrize("field", BAD_FIELDS.values(), ids=BAD_FIELDS)
@pytest.mark.filterwarnings("ignore:overflow")
def test_bad_fields_are_refused(predictor: Predictor, field: np.ndarray) -> None:
    with pytest.raises(InputError, match="contact displacement"):
        predictor.predict(field)


BAD_CONTACTS = {
    "unknown node": ([125], [[0, 0, 0]], "ids from 0 to 124"),
    "negative node": ([-1], [[0, 0, 0]], "ids from 0 to 124"),
    "node twice": ([3, 3], [[0, 0, 0], [0, 0, 1]], "each node once"),
    "no node": ([], np.zeros((0, 3)), "at least one node"),
    "node ids that are no integers": ([1.5], [[0, 0, 0]], "list of at least one node id"),
    "too few displacements": ([1, 2], [[0, 0, 0]], r"shape \(2, 3\)"),
    "two components": ([1], [[0, 0]], r"shape \(1, 3\)"),
    "nan": ([1], [[0, np.nan, 0]], "finite"),
}


@pytest.mark.parametrize(("nodes", "displacements", "message"), BAD_CONTACTS.values(), ids=BAD_CONTACTS)
def test_bad_contacts_are_refused(nodes: object, displacements: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        contact_field(np.array(nodes), np.array(displacements), n_nodes=125)


def test_a_mesh_of_another_topology_is_refused(folder: Path, mesh: TissueMesh) -> None:
    moved = TissueMesh(
        mesh.points + 1.0, mesh.cells, mesh.part, mesh.fixed, mesh.rigid_names, mesh.tissue, mesh.tissue_names,
    )
    with pytest.raises(InputError, match="expected a model of mesh"):
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
        "import json, sys; from mixpinn.stages.prediction import predict_stage\n"
        "predict_stage(*sys.argv[1:])\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    contacts = tmp_path / "contacts.csv"
    contacts.write_text("100,0,-1,0\n101,0,-1,0\n")
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
