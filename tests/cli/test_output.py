"""What a user sees of a failing command: nothing but the line itself, in a process of its own."""

import os
import subprocess
import sys

import pytest

from mixpinn.cli import main
from mixpinn.records import TissueMesh
from pipeline.chain import command


def run(*words):
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    return subprocess.run(
        [sys.executable, "-m", "mixpinn.cli", *map(str, words)], env=environment, capture_output=True, text=True,
        check=False,
    )


def test_libraries_keep_silent(chain, tmp_path):
    mesh = tmp_path / "cut.vtu"
    mesh.write_bytes((chain.mesh / "mesh.vtu").read_bytes()[:2000])
    ended = run("mesh", mesh, "--out", tmp_path / "out")
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1
    assert ended.stderr.startswith(f"mixpinn: {mesh}: expected")
    assert not ended.stdout


def test_mesh_is_drawn_in_silence_without_a_display(chain, tmp_path):
    TissueMesh.load(chain.mesh / "mesh.vtu").save(tmp_path / "given.vtu")
    ended = run("mesh", tmp_path / "given.vtu", "--out", tmp_path / "out")
    assert ended.returncode == 0
    assert (tmp_path / "out" / "mesh.png").is_file() or "no picture" in ended.stderr
    assert "vtk" not in ended.stderr.lower()
    assert "warn" not in ended.stderr.lower()


def test_usage():
    ended = run("anatomy")
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr


def test_closed_output_is_one_that_nobody_reads(chain, monkeypatch):
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    monkeypatch.setattr(sys, "argv", ["mixpinn", "dataset", str(chain.simulation)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0


def test_a_current_folder_that_is_gone_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    outcome = command("dataset", tmp_path)
    assert outcome.code == 2
    assert outcome.lines == ["mixpinn: the current folder was removed; change to another one"]
