"""The benchmarks' history: a line a run, and slow-downs that show."""

import json
from pathlib import Path

import pytest

from benchmarks import history


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(history.FOLDER_VARIABLE, str(tmp_path / "history"))
    return tmp_path / "history"


def test_every_benchmark_ends_in_its_line():
    folder = Path(history.__file__).parent
    for path in sorted(folder.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "__main__" in text and path.stem != "history":
            assert f'report("{path.stem}", ' in text, f"{path.name} keeps no history"


def test_each_run_adds_a_line_and_prints_its_figures(folder, capsys):
    history.report("toy", {"step_seconds": 1.0, "mesh": "block", "shares": {"a": 1.0}})
    history.report("toy", [{"row": 1}], kept={"step_seconds": 1.1})
    printed = capsys.readouterr().out.splitlines()
    assert json.loads(printed[0]) == {"step_seconds": 1.0, "mesh": "block", "shares": {"a": 1.0}}
    assert json.loads(printed[1]) == [{"row": 1}]
    first, second = history.read("toy", folder)
    assert first["figures"] == {"step_seconds": 1.0, "mesh": "block"}
    assert second["figures"] == {"step_seconds": 1.1}
    assert first["machine"].endswith("cores")
    assert first["commit"]


def test_nothing_is_kept_where_the_folder_is_empty(monkeypatch, capsys):
    monkeypatch.setenv(history.FOLDER_VARIABLE, "")
    history.report("toy", {"x": 1.0})
    assert json.loads(capsys.readouterr().out) == {"x": 1.0}
    history.main([])
    assert capsys.readouterr().out == "no runs yet\n"


def test_a_slow_down_on_the_same_machine_shows():
    def run(machine, seconds, ratio=1.0):
        return {"date": "d", "commit": "c", "machine": machine, "figures": {"seconds": seconds, "ratio": ratio}}

    runs = [run("a", 1.0), run("b", 5.0), run("a", 1.1), run("a", 1.4, 9.0), run("b", 4.0)]
    shown = [(row[3], row[4]) for row in history.rows(runs, ("seconds", "ratio"))]
    assert shown == [("1", "1"), ("5", "1"), ("1.1", "1"), ("1.4 !", "9"), ("4", "1")]


def test_the_table_has_times_by_default(folder, capsys):
    history.report("toy", {"step_seconds": 0.25, "error": 3.0})
    capsys.readouterr()
    history.main([])
    name, header, row = capsys.readouterr().out.splitlines()
    assert name == "toy"
    assert header.split() == ["date", "commit", "machine", "step_seconds"]
    assert row.endswith("0.25")
