"""The error budget in a bundle: told with every answer, dropped by a new fit, refused when it is another's."""

import json

import pytest

from mixpinn.base.errors import InputError
from mixpinn.press.files import save_pose_model
from mixpinn.records import MESH_FILE
from mixpinn.records.answer import discretisation_of
from mixpinn.records.error_budget import BUDGET_FILE
from mixpinn.server.scene import SceneFiles
from mixpinn.serving import HybridPredictor
from mixpinn.serving.bundle_budget import keep_budget, load_budget
from mixpinn.stages.hybrid import save_bundle
from records.test_error_budget import budget
from serving.live.pressed import above, block_predictor


@pytest.fixture(scope="module")
def predictor():
    return block_predictor()


@pytest.fixture
def bundle(predictor, tmp_path):
    predictor.mesh.save(tmp_path / MESH_FILE)
    predictor.model.save(tmp_path)
    save_pose_model(predictor.pose, tmp_path)
    return tmp_path


def test_answers_tell_the_budget_of_their_bundle(predictor, bundle):
    assert HybridPredictor.load(bundle, warm_up=False).total is None
    keep_budget(budget(discretisation_of(predictor.mesh)), bundle)
    loaded = HybridPredictor.load(bundle, warm_up=False)
    answer = loaded.press(above().translation)
    assert answer.total == budget().total
    assert "converged solution" in answer.describe()[-1]
    nodes = predictor.model.prior.nodes[:2]
    assert loaded.predict_at(nodes, [[0.0, -1.0, 0.0]] * 2).total == budget().total
    _, scene = SceneFiles.of_predictor(loaded).files["/api/scene.json"]
    assert json.loads(scene)["total_error"] == {"force": 0.4, "motion": 0.25, "depth": 10.0, "presses": 2}


def test_a_budget_of_another_mesh_or_an_altered_one_is_refused(predictor, bundle):
    keep_budget(budget("quadratic tetrahedra, 9 nodes"), bundle)
    with pytest.raises(InputError, match="error budget of linear"):
        load_budget(bundle, predictor.mesh)
    keep_budget(budget(discretisation_of(predictor.mesh)), bundle)
    file = bundle / BUDGET_FILE
    file.write_text(file.read_text().replace("4.0", "1.0"))
    with pytest.raises(InputError, match="altered"):
        load_budget(bundle, predictor.mesh)


def test_a_new_fit_drops_the_budget_of_the_old_one(predictor, bundle):
    keep_budget(budget(discretisation_of(predictor.mesh)), bundle)
    save_bundle(predictor.model, bundle)
    assert load_budget(bundle, predictor.mesh) is None
    assert not (bundle / BUDGET_FILE).exists()
