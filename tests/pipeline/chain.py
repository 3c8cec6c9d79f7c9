"""The whole pipeline at toy size through the real command line, made once for all tests that build on it."""

import contextlib
import fcntl
import io
import json
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest import mock

import pytest

from mixpinn.anatomy.phantom import TINY_PHANTOM
from mixpinn.cli import main
from mixpinn.mesh import Grading

ANATOMY = {"source": "phantom", "phantom": asdict(TINY_PHANTOM)}
MESH = {"size": 4.0, "element": "linear", "grading": asdict(Grading())}
SIMULATION = {
    "workers": 1, "joints": "none", "refinement": None,
    "protocol": {
        "rotations": [0.0], "approach": 0.5, "step": 1.0, "steps": 3, "start": "touch", "max_positions": 6,
    },
}
MODELS = {"names": ["mixpinn"], "width": "tiny", "train": {"max_epochs": 2, "threads": 1}}
RUN = {"title": "Toy", "anatomy": ANATOMY, "mesh": MESH, "simulation": SIMULATION, "models": MODELS}


@dataclass(frozen=True)
class Outcome:
    """Exit code, and what was written to standard error and standard output."""

    code: int
    err: str
    out: str

    @property
    def lines(self):
        return self.err.splitlines()


def command(*words):
    """Run ``mixpinn WORDS`` in this process."""
    err, out = io.StringIO(), io.StringIO()
    code = 0
    written = contextlib.redirect_stderr(err), contextlib.redirect_stdout(out)
    with mock.patch.object(sys, "argv", ["mixpinn", *map(str, words)]), written[0], written[1]:
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return Outcome(code, err.getvalue(), out.getvalue())


def done(*words):
    """Run a command that must succeed."""
    outcome = command(*words)
    assert outcome.code == 0, outcome.err
    return outcome


def contents(folder):
    """Each file below `folder` with its bytes."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@dataclass(frozen=True)
class Chain:
    """Folders of the stages, laid out as ``mixpinn run`` lays them out, and the settings they were made with."""

    root: Path

    @property
    def anatomy(self):
        return self.root / "anatomy"

    @property
    def mesh(self):
        return self.root / "mesh"

    @property
    def simulation(self):
        return self.root / "simulation"

    @property
    def model(self):
        return self.root / "models" / "mixpinn"

    def settings(self, name):
        return self.root.parent / f"{name}.json"

    def words(self, stage, *, out=None):
        """The command that made a stage, into another folder where `out` is given."""
        sources = {
            "anatomy": ["phantom"], "mesh": [self.anatomy], "simulate": [self.mesh], "train": [self.simulation],
        }
        folders = {"anatomy": self.anatomy, "mesh": self.mesh, "simulate": self.simulation, "train": self.model}
        return [stage, *sources[stage], "--config", self.settings(stage), "--out", out or folders[stage]]


@pytest.fixture(scope="session")
def chain(tmp_path_factory):
    """The finished chain from anatomy to trained model; parallel test processes share it."""
    base = tmp_path_factory.getbasetemp()
    base = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "chain"
    base.mkdir(exist_ok=True)
    os.environ.setdefault("MIXPINN_CACHE", str(base / "cache"))
    chain = Chain(base / "run")
    with (base / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (base / "finished").exists():
            stages = {"anatomy": ANATOMY, "mesh": MESH, "simulate": SIMULATION, "train": MODELS}
            for stage, settings in stages.items():
                chain.settings(stage).write_text(json.dumps(settings))
                done(*chain.words(stage))
            chain.settings("run").write_text(json.dumps(RUN))
            (base / "finished").touch()
    return chain
