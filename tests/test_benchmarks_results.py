"""The page of results: sections that are not given keep what an earlier command stored."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.results import __main__ as results
from benchmarks.results import full_scale
from benchmarks.results.bundles import BUNDLES
from benchmarks.results.experiments import render
from benchmarks.results.section import Section, table
from mixpinn.base.files import write_json
from mixpinn.records import Evaluation
from mixpinn.training.history import EpochRecord, write_history

README = "before\n<!-- figures: demo -->\nold\n<!-- end: demo -->\nafter\n"


@pytest.fixture
def sections(monkeypatch):
    def collect(run, images):
        (images / "seen.txt").write_text(str(run)) if images.exists() else None
        return {"figure": float(run.read_text())}

    made = tuple(
        Section(name, collect, lambda data, name=name: f"## {name}\n\n{data['figure']:.2f}\n")
        for name in ("first", "second")
    )
    monkeypatch.setattr(results, "SECTIONS", made)
    return made


@pytest.fixture
def words(tmp_path):
    (tmp_path / "README.md").write_text(README)
    return ["--out", str(tmp_path / "docs" / "page.md"), "--readme", str(tmp_path / "README.md")]


def test_sections_keep_what_an_earlier_command_stored(sections, words, tmp_path):
    for value, names in (("1", ("first",)), ("2", ("second",)), ("3", ("first",))):
        (tmp_path / "run").write_text(value)
        results.main([*words, *(part for name in names for part in (f"--{name}", str(tmp_path / "run")))])
    text = (tmp_path / "docs" / "page.md").read_text()
    assert "## first\n\n[All tables](page/first.md)" in text
    assert "\n3.00\n" in text
    assert "\n2.00\n" in text
    assert (tmp_path / "docs" / "page" / "second.md").read_text() == "# second\n\n\n2.00\n"
    assert text.index("## first") < text.index("## second")
    stored = json.loads((tmp_path / "docs" / "page" / "second.json").read_text())
    assert (stored["section"], stored["figure"]) == ("second", 2.0)
    assert stored["machine"].endswith("cores")


def test_the_page_is_short_and_says_what_its_errors_are_measured_against():
    page = (Path(results.__file__).parents[2] / "docs" / "results.md").read_text()
    assert len(page.splitlines()) <= 250
    for section in results.SECTIONS:
        assert f"[All tables](results/{section.name}.md)" in page
        assert section.kind in page


def test_sections_without_figures_are_left_out(sections, words, tmp_path):
    (tmp_path / "run").write_text("1")
    results.main([*words, "--second", str(tmp_path / "run")])
    assert "## first" not in (tmp_path / "docs" / "page.md").read_text()


def test_readme_is_changed_between_its_markers_alone(tmp_path):
    (tmp_path / "README.md").write_text(README)
    results.fill_readme(tmp_path / "README.md", {"demo": "new", "without a marker": "lost"})
    assert (tmp_path / "README.md").read_text() == README.replace("old", "new")


def test_tables_align_figures_to_the_right():
    assert table(("A", "B"), [("x", 1)]) == "| A | B |\n| --- | ---: |\n| x | 1 |\n"


def test_claims_are_told_in_words_that_follow_from_their_table():
    claims = {
        "title": "The paper's claims", "note": "",
        "columns": ["Claim", "Rows", "Without [mm]", "With [mm]", "Ratio", "Ratio (paper)", "Shown"],
        "rows": [
            ["VN lowers rigid MEE", "2 → 10", 0.4, 0.2, 2.0, 2.1, "yes"],
            ["VN lowers rigid MEE", "3 → 5", 0.48, 0.4, 1.2, 1.9, "no"],
            ["REL lowers REE", "2 → 9", 0.2, 0.3, 0.67, 1.2, "no"],
            ["PhysGNN is last", "PhysGNN against Row 2", 0.6, 0.4, 1.5, 1.9, "yes"],
        ],
    }
    text = render({
        "run": "2026-01-01", "machine": "a machine", "protocol": "A protocol.", "tables": [claims], "pictures": [],
        "further": {"Twice the budget": {"protocol": "Another protocol.", "tables": [claims]}},
    })
    assert "*VN lowers rigid MEE*: shows in 1 of 2 comparisons; the direction is right in 2" in text
    assert "(ratios 2.00, 1.20)" in text
    assert "*REL lowers REE*: does not show in any of 1 comparisons (ratios 0.67)" in text
    assert "*PhysGNN is last*: shows in all 1 comparisons (ratios 1.50)" in text
    assert "- Twice the budget: VN lowers rigid MEE (2 → 10): 0.400 against 0.200 mm, ratio 2.00;" in text
    assert "#### Twice the budget\n\nAnother protocol." in text
    assert text.count("| REL lowers REE | 2 → 9 |") == 2


def test_networks_at_full_width_stand_beside_the_ridge_and_the_paper(tmp_path, monkeypatch):
    run, training = tmp_path / "evaluation", tmp_path / "row-10"
    for folder in (run, training, tmp_path / "images"):
        folder.mkdir()
    write_json(run / "run.json", {"started": "2026-01-02T03:04:05"})
    write_json(training / "run.json", {"config": {"training": {"learning_rate": 0.001, "batch_size": 4}}})
    write_history(training, [EpochRecord(1, 0.9, 0.8, 1e-3, 60.0), EpochRecord(2, 0.7, 0.9, 1e-3, 120.0)])
    errors = np.array([0.1, 0.2, 0.6])
    Evaluation(
        "row-10", "test", dict.fromkeys(("mee", "mae", "mse", "rigid_mee", "soft_mee", "ree"), errors),
        {"position": np.array([3.0, 3.0, 8.0]), "rotation": np.zeros(3), "depth": np.ones(3)}, {}, np.full(3, 0.01),
    ).save(run / "evaluation-00-row-10.json")
    monkeypatch.setattr(full_scale, "RESULTS", tmp_path)
    ridge = {"model": full_scale.RIDGE, "mee": 0.0172, "rigid_mee": 0.0163, "soft_mee": 0.0177, "ree": 0.0,
             "mee_p95": 0.0449, "mee_max": 0.0608}
    write_json(tmp_path / "hybrid.json", {"sofa": [{"model": "Elastic prior", "mee": 0.03}, ridge]})
    data = full_scale.collect([str(run), str(training)], tmp_path / "images")
    text = full_scale.render({**json.loads(json.dumps(data)), "machine": "a machine"})
    assert "3 samples at 2 test positions" in text
    assert "| row-10 | 0.3000 | 0.3000 | 0.3000 | 0.3000 | 0.3000 | 0.3000 | 0.5600 | 0.6000 |" in text
    assert f"| {full_scale.RIDGE} | 0.0172 | – | – | 0.0163 |" in text
    assert "| *MIXPINN, the paper's own samples* | 0.2588 |" in text  # the paper's Table of models
    assert "| row-10 | 2 | 1 | 0.9000 | 0.8000 | 3 | 0.001 | 4 |" in text
    assert (tmp_path / "images" / full_scale.PICTURE).stat().st_size > 5_000


def test_bundles_show_what_was_measured_of_them_and_a_dash_for_the_rest(tmp_path):
    run = tmp_path / "one"
    run.mkdir()
    rounds = [
        {"stage": "prior", "minutes": 0.4},
        {"stage": "8 poses", "poses": 8, "prior_mee": 0.03, "model_mee": 0.03, "no_motion": 0.5, "minutes": 3.0},
        {"stage": "16 poses", "poses": 8, "prior_mee": 0.02, "model_mee": 0.0123, "no_motion": 0.4, "minutes": 7.0},
    ]
    write_json(run / "rounds.json", {"seconds": 420.0, "rounds": rounds})
    bare = BUNDLES.collect([f"a patient={run}"], tmp_path)
    assert "| a patient | 16 | 0.40 | 0.0200 | 0.0123 | – | – | – | – |" in BUNDLES.brief(bare)
    write_json(run / "dependability.json", {
        "answers": 3240, "answered": 0.998, "unconverged": 0, "absurd": 0, "jumps": 1, "dips": 0, "nonsense_passed": 0,
        "thread_differences": 0, "pose_mee": 0.0412, "pose_mee_max": 0.31,
        "bound_coverage": {"field": 1.0, "force": 0.96, "motion": 0.95},
        "bound_sharpness": {"field": 2.5, "force": 3.4, "motion": 2.6},
    })
    text = BUNDLES.render(BUNDLES.collect([f"a patient={run}"], tmp_path))
    assert "| a patient | 16 | 0.40 | 0.0200 | 0.0123 | – | 0.041 | 0.31 | – |" in text
    assert "Growth" not in text
    write_json(run / "latency.json", {
        "contact_ms_p50": 2.731, "contact_ms_p99": 4.5, "outputs_ms_p50": 2.59, "pose_ms_p50": 8.2, "pose_ms_p99": 13.1,
        "one_thread_pose_ms_p50": 8.2, "busy_pose_ms_p99": 13.9, "growth": 1.2, "finer_nodes": 85351,
        "bundle_mb": 116.0, "all_nodes": 21264,
    })
    timed = BUNDLES.render(BUNDLES.collect([f"a patient={run}"], tmp_path))
    assert "(85,351 nodes)" in timed
    assert "| a patient | 21,264 | 2.73 | 4.50 | 2.59 | 8.20 | 13.10 | 8.20 | 13.90 | 1.20 | 116.00 |" in timed
    assert "| a patient | 3240 | 99.8% | 0 / 0 / 1 / 0 | 0 | 0 | 1.00 / 0.96 / 0.95 | 2.5 / 3.4 / 2.6 |" in text
