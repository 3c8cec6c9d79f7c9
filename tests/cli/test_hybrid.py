"""The hybrid model and onboarding through the real command line, at toy size."""

import json
import shutil

import pytest
import pyvista as pv

from mixpinn.base.files import read_json
from mixpinn.base.rundir import start_run
from mixpinn.serving import HybridPredictor
from pipeline.chain import ANATOMY, MESH, SIMULATION, command, contents, done


@pytest.fixture(scope="module")
def bundle(chain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("hybrid") / "bundle"
    done("train", chain.simulation, "--model", "hybrid", "--out", folder, "--set", "hybrid.modes=6")
    return folder


def test_a_bundle_holds_all_that_serving_needs(chain, bundle):
    assert {"hybrid.json", "hybrid.safetensors", "mesh.vtu", "run.json", "split.json"} < {
        path.name for path in bundle.iterdir()
    }
    assert read_json(bundle / "run.json")["stage"] == "hybrid"
    assert HybridPredictor.load(bundle).mesh_hash == read_json(chain.simulation / "store" / "store.json")["mesh_hash"]


def test_same_command_again_keeps_it_and_other_settings_are_refused(chain, bundle):
    words = ("train", chain.simulation, "--model", "hybrid", "--out", bundle)
    before = (bundle / "hybrid.safetensors").stat().st_mtime_ns
    done(*words, "--set", "hybrid.modes=6")
    assert (bundle / "hybrid.safetensors").stat().st_mtime_ns == before
    outcome = command(*words, "--set", "hybrid.modes=7")
    assert outcome.code == 2
    assert "another config" in outcome.lines[-1]


def test_it_stands_in_the_report_beside_the_prior(chain, bundle, tmp_path):
    done("evaluate", chain.simulation, bundle, "--no-pictures", "--out", tmp_path / "evaluation")
    results = json.loads((tmp_path / "evaluation" / "results.json").read_text())
    assert "Hybrid" in json.dumps(results)
    assert (tmp_path / "evaluation" / "report.html").is_file()


def test_it_predicts_a_sample_of_the_store(chain, bundle, tmp_path):
    said = done("predict", bundle, "--simulations", chain.simulation, "--out", tmp_path / "deformed.vtu").out
    assert "moved by" in said
    assert "Expected mean error against the solver" in said
    grid = pv.read(tmp_path / "deformed.vtu")
    error = ((grid["displacement"] - grid["reference"]) ** 2).sum(axis=1) ** 0.5
    scale = (grid["reference"] ** 2).sum(axis=1) ** 0.5
    assert error.mean() < 0.1 * scale.mean()


@pytest.mark.parametrize(("change", "message"), [
    ("hybrid.modes=0", "at least 1"), ("hybrid.ridge=[]", "positive numbers"), ("hybrid.mode=3", "hybrid.mode"),
])
def test_settings_that_make_no_model_are_one_line(chain, tmp_path, change, message):
    outcome = command("train", chain.simulation, "--model", "hybrid", "--out", tmp_path / "x", "--set", change)
    assert outcome.code == 2
    assert message in outcome.lines[-1]
    assert not (tmp_path / "x").exists()


@pytest.fixture(scope="module")
def onboarded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("onboard")
    config = folder / "config.json"
    config.write_text(json.dumps({
        "anatomy": ANATOMY, "mesh": {**MESH, "element": "linear"}, "simulation": {**SIMULATION, "refinement": None},
        "budget": {"finer": "quadratic"},
        "first_round": 4, "hybrid": {"modes": 4},
    }))
    words = ("onboard", "phantom", "--config", config, "--no-pictures", "--out", folder / "run")
    done(*words, "--poses", 0)
    after_prior = contents(folder / "run" / "bundle")
    done(*words, "--poses", 6)
    return folder / "run", after_prior


def test_onboarding_gives_the_prior_first_and_learns_when_asked_again(onboarded):
    run, after_prior = onboarded
    assert any("hybrid.json" in str(name) for name in after_prior)
    rounds = read_json(run / "rounds.json")["rounds"]
    assert [entry["stage"] for entry in rounds] == ["prior", "4 poses", "6 poses"]
    assert rounds[1]["model_mee"] == pytest.approx(rounds[1]["prior_mee"], rel=1e-5)  # nothing learned yet
    predictor = HybridPredictor.load(run / "bundle")
    assert predictor.name == "Hybrid"
    assert predictor.model.about["training_samples"] > 0


def test_onboarding_leaves_a_report(onboarded):
    run, _ = onboarded
    page = (run / "onboarding.md").read_text()
    assert "6 poses" in page
    assert "elastic prior could be used" in page
    assert (run / "onboarding.png").read_bytes()[:4] == b"\x89PNG"
    assert (run / "evaluation" / "report.html").is_file()


def test_onboarding_tells_the_error_against_the_converged_solution(onboarded, tmp_path):
    run, _ = onboarded
    predictor = HybridPredictor.load(run / "bundle", warm_up=False)
    assert predictor.budget is not None
    assert predictor.budget.complete
    assert {entry.source for entry in predictor.budget.entries} >= {"predictor", "contact penalty", "discretisation"}
    for page in (run / "onboarding.md", run / "evaluation" / "report.html", run / "evaluation" / "results.md"):
        assert predictor.budget.sentence[:60] in page.read_text()
    tip = ",".join(str(value) for value in predictor.budget.tips[0])
    said = done("predict", run / "bundle", f"--tip={tip}", "--out", tmp_path / "deformed.vtu").out
    assert "Against the converged solution: the force may be off by about" in said


def test_onboarding_stopped_in_its_last_test_goes_on(onboarded, tmp_path):
    run, _ = onboarded
    shutil.copytree(run, tmp_path / "run")
    shutil.rmtree(tmp_path / "run" / "evaluation")
    start_run(tmp_path / "run" / "evaluation", "evaluate", {"bundle": "as it was before the stop"})
    config = run.parent / "config.json"
    done("onboard", "phantom", "--config", config, "--no-pictures", "--out", tmp_path / "run", "--poses", 6)
    assert (tmp_path / "run" / "evaluation" / "report.html").is_file()


def test_onboarding_refuses_what_makes_no_round(tmp_path):
    outcome = command("onboard", "phantom", "--out", tmp_path / "x", "--set", "first_round=2")
    assert outcome.code == 2
    assert "at least 4" in outcome.lines[-1]
    assert not (tmp_path / "x").exists()
