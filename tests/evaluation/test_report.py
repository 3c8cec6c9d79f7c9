"""The report is one file that needs nothing else and says what was measured."""

import csv
import dataclasses
import json
import re
from pathlib import Path

import pytest

from mixpinn.base.errors import InputError
from mixpinn.evaluation import (
    LIMITS,
    Picture,
    ReportContent,
    Table,
    error_by_part,
    mesh_table,
    save_figure,
    summarise_run,
    write_report,
)
from mixpinn.records import Evaluation, TissueMesh
from records.test_error_budget import budget


@pytest.fixture
def content(evaluations: tuple[Evaluation, ...], two_cells: TissueMesh, tmp_path: Path) -> ReportContent:
    """All sections filled."""
    log = tmp_path / "history.csv"
    log.write_text("epoch,train_loss,validation_loss,learning_rate\n1,2.0,2.5,5e-4\n2,1.0,1.5,5e-4\n")
    save_figure(error_by_part(evaluations), tmp_path / "picture.png", dpi=30)
    return ReportContent(
        "Phantom <of> two cells", evaluations, introduction="A probe & a block.", mesh=mesh_table(two_cells),
        setup=(Table("Fidelity", ("Structure", "Dice"), (("body", 0.98),)),), protocol={"Contact nodes": "loaded"},
        loss_logs={"MIXPINN": log}, pictures=(Picture(tmp_path / "picture.png", "A picture."),),
        stage_seconds={"mesh": 12.3, "train": 125.0}, fem_seconds=1.2,
        provenance={"Seeds": {"training": "7"}, "Inputs": {"body.nii.gz": "ab" * 32}}, limits=("Toy data.",),
    )


def test_page_is_self_contained_and_holds_every_section(content: ReportContent, tmp_path: Path) -> None:
    page = write_report(tmp_path / "report", content).read_text()
    assert "http://" not in page
    assert "https://" not in page
    assert not re.search(r"<(script|link|iframe)|@import|url\(", page)
    images = re.findall(r"<img src=\"([^\"]{0,40})", page)
    assert len(images) == 5
    assert all(source.startswith("data:image/png;base64,") for source in images)
    for anchor in re.findall(r"href=\"#(\w+)\"", page):
        assert f'id="{anchor}"' in page
    assert "<title>Phantom &lt;of&gt; two cells</title>" in page
    for text in (
        "A probe &amp; a block.", "Fidelity", "loaded", "A picture.", "2 min 05 s", "2 min 17 s", "ab" * 32,
        "Toy data.", "MEE [mm] by depth", "95 % low", "MIXPINN",
    ):
        assert text in page
    assert page.count("<li>") == 1 + len(LIMITS)


def test_headline_in_plain_words(content: ReportContent) -> None:
    headline = summarise_run(content)
    # MEE 0.75 mm of a mean motion of 6 mm, 12 ms.
    assert "20 simulated situations at 4 probe positions" in headline.sentence
    assert "MIXPINN predicts the position of each point of the body to 0.75 mm on average" in headline.sentence
    assert "8.0 times better than predicting no motion" in headline.sentence
    assert "Mean errors for comparison: Simple GAT 1.8 mm." in headline.sentence
    assert "12 ms, against 1,200 ms" in headline.sentence
    assert ("0.75 mm", "mean error of MIXPINN") in headline.cards


def test_one_position_has_no_interval(content: ReportContent, evaluations: tuple[Evaluation, ...]) -> None:
    assert "95 % interval" in summarise_run(content).sentence
    for evaluation in evaluations:
        evaluation.about["position"][:] = 3.0
    sentence = summarise_run(content).sentence
    assert "at one probe position" in sentence
    assert "95 % interval" not in sentence


def test_headline_owns_up_to_a_useless_model(content: ReportContent, evaluations: tuple[Evaluation, ...]) -> None:
    evaluations[2].metrics["mee"][:] = 9.0
    headline = summarise_run(dataclasses.replace(content, evaluations=evaluations[2:]))
    assert "no better than predicting no motion" in headline.sentence


def test_empty_sections_are_left_out(evaluations: tuple[Evaluation, ...], tmp_path: Path) -> None:
    content = ReportContent("Bare", evaluations[:1], picture_note="No OpenGL here.")
    page = write_report(tmp_path, content).read_text()
    assert "No OpenGL here." in page
    for section in ("simulated", "stages", "provenance"):
        assert f'id="{section}"' not in page
    assert "(paper)" not in page


def test_files_beside_the_page(content: ReportContent, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    write_report(folder, dataclasses.replace(content, with_paper=True))
    assert {path.name for path in folder.iterdir()} == {"report.html", "results.csv", "results.json", "results.md"}
    results = json.loads((folder / "results.json").read_text())
    assert [model["model"] for model in results["models"]] == ["No motion", "Simple GAT", "MIXPINN"]
    assert results["models"][2]["metrics"]["mee"]["mean"] == pytest.approx(0.75)
    assert results["models"][2]["mee_by_depth"]["depth"] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert results["models"][2]["milliseconds"]["mean"] == pytest.approx(12.0)
    with (folder / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 18
    assert float(rows[12]["Mean"]) == pytest.approx(0.75)
    text = (folder / "results.md").read_text()
    assert "### Models compared" in text
    assert "MIXPINN (paper)" in text


def test_same_seed_gives_the_same_figures(content: ReportContent) -> None:
    first, second = summarise_run(content), summarise_run(content)
    assert first == second
    assert summarise_run(dataclasses.replace(content, seed=1)).sentence.startswith("On 20 simulated situations")


def test_nothing_to_report_is_refused(content: ReportContent, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one evaluated model"):
        write_report(tmp_path / "none", ReportContent("Empty", ()))
    missing = dataclasses.replace(content, pictures=(Picture(tmp_path / "absent.png", "gone"),))
    with pytest.raises(InputError, match="no such file"):
        write_report(tmp_path / "report", missing)
    assert not (tmp_path / "report").exists()


def test_the_error_against_the_converged_solution_has_a_section_of_its_own(content, tmp_path):
    told = budget()
    page = write_report(tmp_path / "report", dataclasses.replace(content, budget=told)).read_text()
    assert 'id="budget"' in page
    assert told.sentence in page
    assert ("40 %", "of the force may be wrong, against the converged solution") in summarise_run(
        dataclasses.replace(content, budget=told),
    ).cards
    assert json.loads((tmp_path / "report" / "results.json").read_text())["budget"]["total_force"] == told.total_force
    assert 'id="budget"' not in write_report(tmp_path / "without", content).read_text()
