"""Whatever stands in a settings file, the command line answers in one line and leaves nothing half-written."""

import json

import numpy as np
import pytest

from pipeline.chain import RUN, command, contents

ODD = (None, True, -1, 0, 1e400, -1e-300, 10**30, "", "\x00", "nan", "../..", [], [[]], {}, {"a": 1}, [1, "x", None])


def places(value, path=()):
    """Every path into nested settings."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield (*path, key)
            yield from places(inner, (*path, key))


def altered(settings, rng):
    """A copy of nested settings with one entry replaced, removed or added."""
    copy = json.loads(json.dumps(settings))
    paths = list(places(copy))
    path = paths[rng.integers(len(paths))]
    owner = copy
    for key in path[:-1]:
        owner = owner[key]
    kind = rng.integers(3)
    if kind == 0:
        owner[path[-1]] = ODD[rng.integers(len(ODD))]
    elif kind == 1:
        owner[path[-1] + "x"] = owner.pop(path[-1])
    else:
        owner[path[-1]] = {"of": owner[path[-1]]}
    return copy


@pytest.mark.parametrize("seed", range(3))
def test_settings(tmp_path, seed, drill):
    rng = np.random.default_rng(seed)
    for number in range(300 if drill else 4):
        settings = altered({"mesh": RUN["mesh"], "simulation": RUN["simulation"], "models": RUN["models"]}, rng)
        # An anatomy that is not there ends every run that survives its settings before anything is computed.
        settings["anatomy"] = {"source": "folder", "path": str(tmp_path / "absent")}
        file, out = tmp_path / f"{number}.json", tmp_path / f"out-{number}"
        file.write_text(json.dumps(settings))
        outcome = command("run", file, "--out", out)
        said = f"{settings}: {outcome.err}"
        assert outcome.code == 2, said
        assert "Traceback" not in outcome.err, said
        assert sum(line.startswith("mixpinn: ") for line in outcome.lines) == 1, said
        kept = {name for name in contents(out) if not name.endswith("run.json")} if out.exists() else set()
        assert not kept, said
