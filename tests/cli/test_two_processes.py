"""A second process in a run directory is refused in one line, whatever the verb, and leaves it as it is."""

import os
import subprocess
import sys

import numpy as np
import pytest

from mixpinn.dataset import SimulationStore
from pipeline.chain import command, contents, done
from serving.live.pressed import block_predictor, save_bundle

HOLD = "import sys; from mixpinn.base.lock import acquire; acquire(sys.argv[1]); print('held', flush=True); " \
    "sys.stdin.read()"


@pytest.fixture
def at_work(tmp_path):
    """A folder that another process works in, and the number of that process."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path / "out"], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True,
    )
    assert process.stdout.readline() == "held\n"
    yield tmp_path / "out", process.pid
    process.communicate()


def test_every_verb_is_refused_in_a_folder_that_another_process_works_in(chain, at_work, tmp_path):
    out, process = at_work
    assert process != os.getpid()
    store, run = chain.simulation, chain.settings("run")
    np.savetxt(tmp_path / "positions.txt", SimulationStore.open(store / "store").positions)
    for words in (
        *(chain.words(stage, out=out) for stage in ("anatomy", "mesh", "simulate", "train")),
        ["evaluate", store, chain.model, "--out", out, "--no-pictures"],
        ["train", store, "--model", "hybrid", "--out", out], ["run", run, "--out", out],
        ["demo", "--out", out], ["onboard", "phantom", "--out", out],
        ["ablate", store, "--out", out, "--model", "row-1"], ["profile", chain.mesh, "--out", out],
        ["export", "sofa", chain.mesh, "--config", chain.settings("simulate"), "--out", out],
        [
            "import", "sofa", tmp_path, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt",
            "--paper-constants", "--out", out,
        ],
        [
            "assess", save_bundle(block_predictor(), tmp_path / "bundle"), "--poses", "1", "--finer", "quadratic",
            "--out", out,
        ],
    ):
        outcome = command(*words)
        assert outcome.code == 2, words
        assert f"process {process} at work in it" in outcome.lines[-1], words
        assert "Traceback" not in outcome.err, words
        assert sorted(contents(out)) == [".lock"], words


def test_verbs_without_a_run_directory_work_beside_another_process(chain, at_work):
    out, _ = at_work
    (out / "contacts.csv").write_text("node,dx,dy,dz\n" + f"{top_node(chain)},0,-1,0\n")
    beside = {"contacts.csv", ".lock"}
    done("predict", chain.model, "--contacts", out / "contacts.csv", "--out", out / "answer.vtu")
    first = (out / "answer.vtu").read_bytes()
    done("predict", chain.model, "--contacts", out / "contacts.csv", "--out", out / "answer.vtu")
    assert (out / "answer.vtu").read_bytes() == first
    assert set(contents(out)) == beside | {"answer.vtu"}
    assert done("dataset", chain.simulation).out == done("dataset", chain.simulation).out


def top_node(chain):
    mesh = SimulationStore.open(chain.simulation / "store").mesh()
    skin = np.unique(mesh.skin_faces)
    return int(skin[mesh.points[skin, 1].argmax()])
