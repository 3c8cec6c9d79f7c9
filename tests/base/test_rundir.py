import os
import subprocess
import sys

import pytest

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.rundir import finish_run, is_finished, run_scope, start_run, withdraw_unused_runs


def test_same_run_goes_on_and_another_is_refused(tmp_path):
    (tmp_path / "in.txt").write_text("one")
    run = {"inputs": {"text": tmp_path / "in.txt"}, "seed": 3}
    assert not start_run(tmp_path / "out", "stage", {"size": (1, 2)}, **run)
    assert start_run(tmp_path / "out", "stage", {"size": (1, 2)}, **run)
    for stage, config, seed, changed in (
        ("other", {"size": (1, 2)}, 3, "stage"), ("stage", {"size": (1, 3)}, 3, "config"),
        ("stage", {"size": (1, 2)}, 4, "seed"),
    ):
        with pytest.raises(InputError, match=f"another {changed}"):
            start_run(tmp_path / "out", stage, config, inputs=run["inputs"], seed=seed)
    (tmp_path / "in.txt").write_text("two")
    with pytest.raises(InputError, match="another inputs"):
        start_run(tmp_path / "out", "stage", {"size": (1, 2)}, **run)


def test_a_folder_of_an_artefact_is_no_run_directory(tmp_path):
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="vouches for"):
        start_run(tmp_path, "stage", {})
    assert not (tmp_path / "run.json").exists()


def test_record_tells_results(tmp_path):
    start_run(tmp_path, "stage", {})
    assert not is_finished(tmp_path)
    finish_run(tmp_path, {"error": 0.5})
    assert is_finished(tmp_path)
    assert read_json(tmp_path / "run.json")["results"] == {"error": 0.5}


def test_run_without_results_can_be_withdrawn(tmp_path):
    (tmp_path / "there").mkdir()
    for name in ("empty", "there", "used"):
        start_run(tmp_path / name, "stage", {})
    start_run(tmp_path / "outer", "run", {})
    start_run(tmp_path / "outer" / "inner", "stage", {})
    (tmp_path / "used" / "result").touch()
    withdraw_unused_runs()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there", "used"]
    assert not list((tmp_path / "there").iterdir())
    assert (tmp_path / "used" / "run.json").exists()
    start_run(tmp_path / "there", "stage", {"other": 1})


def test_run_begun_earlier_stays(tmp_path):
    start_run(tmp_path / "earlier", "stage", {})
    from mixpinn.base import rundir

    rundir._begun.clear()  # as in a new process
    start_run(tmp_path / "earlier", "stage", {})
    withdraw_unused_runs()
    assert (tmp_path / "earlier" / "run.json").exists()


def test_another_process_is_refused_until_the_run_is_finished(tmp_path):
    code = "import sys; from mixpinn.base.rundir import start_run; start_run(sys.argv[1], 'stage', {})"

    def other():
        return subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=False)

    start_run(tmp_path, "stage", {})
    refused = other()
    assert refused.returncode != 0
    assert f"process {os.getpid()} at work in it" in refused.stderr
    finish_run(tmp_path, {})
    assert other().returncode == 0
    with run_scope():
        start_run(tmp_path, "stage", {})
        assert other().returncode != 0
    assert other().returncode == 0


def test_a_stage_that_failed_lets_go_of_its_folders_and_of_no_others(tmp_path):
    @run_scope()
    def stage(folder):
        start_run(folder / "inner", "stage", {})
        raise ValueError("failed")

    @run_scope()
    def pipeline():
        start_run(tmp_path, "run", {})
        with pytest.raises(ValueError, match="failed"):
            stage(tmp_path)
        assert (tmp_path / ".lock").exists()
        assert not (tmp_path / "inner" / ".lock").exists()
        stage(tmp_path)

    with pytest.raises(ValueError, match="failed"):
        pipeline()
    assert not list(tmp_path.rglob(".lock"))
    assert (tmp_path / "inner" / "run.json").exists()  # as after any interruption: the same run continues
    assert start_run(tmp_path / "inner", "stage", {})
