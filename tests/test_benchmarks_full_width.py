"""What benchmarks.full_width takes up again, and how benchmarks.gpu ends what it has started."""

import argparse
import subprocess
import sys
import time

import pytest

from benchmarks import full_width, gpu
from mixpinn.base.files import write_json


def options(out, **changed):
    return argparse.Namespace(**{
        "out": out, "models": ["row-1", "row-10"], "seeds": [0, 1], "epochs": 10, "width": "authors",
        "learning_rate": 1e-3, **changed,
    })


def test_only_results_of_the_same_settings_count(tmp_path):
    asked, longer = options(tmp_path), options(tmp_path, epochs=50)
    for name, seed, settings in (
        ("row-1", 0, full_width.settings_of(asked)), ("row-10", 0, full_width.settings_of(longer)),
        ("row-10", 1, None),
    ):
        write_json(tmp_path / f"{name}-seed-{seed}" / "result.json", {
            "model": name, "seed": seed, **({} if settings is None else {"settings": settings}),
        })
    assert [(one["model"], one["seed"]) for one in full_width.results(asked)] == [("row-1", 0)]
    assert [(one["model"], one["seed"]) for one in full_width.results(longer)] == [("row-10", 0)]
    assert full_width.results(options(tmp_path, learning_rate=1e-4)) == []


def test_what_takes_too_long_ends_with_all_that_it_has_started(tmp_path):
    begun, ended = tmp_path / "begun", tmp_path / "ended"
    child = f"import pathlib, time; pathlib.Path({str(begun)!r}).touch(); time.sleep(3); " \
            f"pathlib.Path({str(ended)!r}).touch()"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-S', '-c', {child!r}])"
    with pytest.raises(subprocess.TimeoutExpired):
        gpu.run_within(2.0, [sys.executable, "-S", "-c", parent])
    assert begun.is_file()
    time.sleep(2.0)
    assert not ended.exists()


def test_what_ends_by_itself_is_waited_for(tmp_path):
    gpu.run_within(30.0, [sys.executable, "-S", "-c", f"open({str(tmp_path / 'done')!r}, 'w').close()"])
    assert (tmp_path / "done").is_file()
