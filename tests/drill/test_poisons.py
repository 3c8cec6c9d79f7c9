"""Every poison is refused in one line, in little time and memory, and leaves nothing behind."""

import resource
import time

from drill.kitchen import Kitchen
from drill.poisons import POISONS
from pipeline.chain import command, contents
from stages.test_seal import bundle  # noqa: F401 (a fixture)

SECONDS, GIGABYTES = 20.0, 2.0


def pytest_generate_tests(metafunc):
    names = list(POISONS)
    metafunc.parametrize("name", names if metafunc.config.getoption("--drill") else names[::3])


def peak_memory():
    """Largest resident size of this process, and of those that it has ended [GB]."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 2**20


def test_poison(name, chain, bundle, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setenv("COLUMNS", "200")
    kitchen = Kitchen(chain, bundle, tmp_path)
    words = POISONS[name](kitchen)
    began, memory = time.process_time(), peak_memory()
    outcome = command(*words)
    assert outcome.code == 2, (outcome.code, outcome.out[-500:], outcome.err[-500:])
    said = [line for line in outcome.lines if line.startswith("mixpinn: ")]
    assert len(said) == 1, outcome.err
    assert said[0] == outcome.lines[-1]
    assert len(said[0]) < 700
    assert "Traceback" not in outcome.err
    assert not kitchen.out.exists() or not contents(kitchen.out)
    assert time.process_time() - began < SECONDS
    assert peak_memory() < GIGABYTES or peak_memory() == memory
