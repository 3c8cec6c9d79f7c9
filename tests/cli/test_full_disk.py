"""A full disk, played by a limit on the size of files: one line, exit code 2, and only whole files left."""

import contextlib
import errno
import os
import resource
import shutil

import pytest

from mixpinn.base.rundir import is_finished
from mixpinn.records import TissueMesh
from pipeline.chain import command, contents, done


@contextlib.contextmanager
def largest_file(size):
    """No file of this process or its children may grow beyond `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def says_so(outcome):
    assert outcome.code == 2, outcome.err
    assert outcome.lines[-1].startswith("mixpinn: ")
    assert "free some space" in outcome.lines[-1]
    assert "Traceback" not in outcome.err


def whole(folder):
    """Assert that no temporary file is left, and return what is there."""
    left = contents(folder) if folder.exists() else {}
    assert not [name for name in left if ".writing-" in name]
    return left


@pytest.mark.parametrize("stage", ["anatomy", "mesh", "train"])
def test_stage_stops_and_goes_on_when_there_is_room_again(chain, tmp_path, stage):
    finished = chain.words(stage)[-1]
    out = tmp_path / "out"
    largest = max(len(content) for content in contents(finished).values())
    with largest_file(largest - 1):
        says_so(command(*chain.words(stage, out=out)))
    whole(out)
    assert not is_finished(out)
    done(*chain.words(stage, out=out))
    assert is_finished(out)


def test_simulation_stops_in_its_worker(chain, tmp_path):
    shutil.copytree(chain.simulation, tmp_path / "out")
    store = tmp_path / "out" / "store"
    pose = store / "pose_003_000"
    largest = max(path.stat().st_size for path in pose.rglob("*") if path.is_file())
    before = contents(pose)
    shutil.rmtree(pose)
    with largest_file(largest - 1):
        says_so(command(*chain.words("simulate", out=tmp_path / "out")))
    whole(tmp_path / "out")
    assert not pose.exists()
    done(*chain.words("simulate", out=tmp_path / "out"))
    assert contents(pose).keys() == before.keys()


@pytest.mark.parametrize("suffix", [".vtu", ".stl", ".ply"])
def test_prediction_is_whole_or_absent(chain, tmp_path, suffix):
    with largest_file(5000):
        says_so(command(
            "predict", chain.model, "--simulations", chain.simulation, "--out", tmp_path / f"p{suffix}",
        ))
    assert not whole(tmp_path)


def test_report_is_whole_or_absent(chain, tmp_path):
    with largest_file(50_000):
        says_so(command(
            "evaluate", chain.simulation, chain.model, "--no-pictures", "--out", tmp_path / "e",
        ))
    assert "report.html" not in whole(tmp_path / "e")


def test_disk_that_fills_up_at_the_last_moment(chain, tmp_path, monkeypatch):
    def full(source, target):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))

    monkeypatch.setattr(os, "replace", full)
    mesh = TissueMesh.load(chain.mesh / "mesh.vtu")
    mesh.grid().save(tmp_path / "given.vtu")
    says_so(command("mesh", tmp_path / "given.vtu", "--out", tmp_path / "out"))
    assert not whole(tmp_path / "out")
