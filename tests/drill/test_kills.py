"""Every verb, killed and stopped at any moment, and twice at once: what comes out in the end is what an undisturbed
run gives, and nothing stays behind.
"""

import json
import signal
import time
import zlib

import numpy as np
import pytest

from cli.test_ablate import SETTINGS as ABLATE
from cli.test_profile import SETTINGS as PROFILE
from drill.kill_drill import Pace, Verb, killed, two_at_once, whole
from mixpinn.dataset import SimulationStore
from mixpinn.records import MESH_FILE, TissueMesh
from pipeline.chain import ANATOMY, MESH, MODELS, RUN, SIMULATION
from serving.live.pressed import block_predictor, save_bundle

KINDS = ("SIGKILL", "SIGTERM", "SIGINT", "worker")
NAMES = (
    "anatomy", "mesh", "simulate", "dataset", "train", "train-hybrid", "evaluate", "predict", "run", "onboard",
    "ablate", "profile", "export-sofa", "import-sofa", "assess",
)


@pytest.fixture(scope="module", autouse=True)
def long(drill):
    if not drill:
        pytest.skip("only in 'make drill': simulations and ablations that are killed are in tests/cli")


@pytest.fixture(scope="module")
def pace(chain, tmp_path_factory):
    """How long one small command takes here and now."""
    words = ("mesh", str(chain.anatomy), "--config", str(chain.settings("mesh")))
    return Pace(whole(Verb("mesh", words), tmp_path_factory.mktemp("pace"))[0])


@pytest.fixture(scope="module")
def verbs(chain, pace, tmp_path_factory):
    """Each command at toy size, with time-outs as short as this machine allows."""
    folder = tmp_path_factory.mktemp("kills")
    simulation = {**SIMULATION, "timeout": pace.timeout, "workers": 2}
    mesh = {**MESH, "timeout": 4.0 * pace.timeout}

    def settings(name, values):
        path = folder / f"{name}.json"
        path.write_text(json.dumps(values))
        return str(path)

    skin = TissueMesh.load(chain.mesh / MESH_FILE)
    node = int(np.unique(skin.skin_faces)[skin.points[np.unique(skin.skin_faces), 1].argmax()])
    (folder / "contacts.csv").write_text(f"node,dx,dy,dz\n{node},0,-1,0\n")
    hybrid = ["--set", "hybrid.modes=6"]
    onboarding = {
        "anatomy": ANATOMY, "mesh": {**mesh, "element": "linear"}, "simulation": {**simulation, "refinement": None},
        "hybrid": {"modes": 6}, "budget": {"finer": "quadratic"},
        "poses": 6, "first_round": 4,
    }
    run = {**RUN, "mesh": mesh, "simulation": simulation, "models": MODELS, "evaluation": {"pictures": False}}
    profiled = {**PROFILE["simulation"], "timeout": pace.timeout}
    profile = PROFILE | {"simulation": profiled, "timeout": 6.0 * pace.timeout}
    store = str(chain.simulation)
    commands = {
        "anatomy": ["anatomy", "phantom", "--config", settings("anatomy", ANATOMY)],
        "mesh": ["mesh", str(chain.anatomy), "--config", settings("mesh", mesh)],
        "simulate": ["simulate", str(chain.mesh), "--config", settings("simulate", simulation)],
        "dataset": ["dataset", store],
        "train": ["train", store, "--config", settings("train", MODELS)],
        "train-hybrid": ["train", store, "--model", "hybrid", *hybrid],
        "evaluate": ["evaluate", store, str(chain.model), "--no-pictures", "--threads", "1"],
        "predict": ["predict", str(chain.model), "--contacts", str(folder / "contacts.csv"), "--threads", "1"],
        "run": ["run", settings("run", run), "--threads", "1"],
        "onboard": ["onboard", "phantom", "--config", settings("onboard", onboarding), "--no-pictures"],
        "ablate": [
            "ablate", store, "--protocol", "desk", "--workers", "2", "--config",
            settings("ablate", ABLATE | {"timeout": 5.0 * pace.timeout}),
        ],
        "profile": ["profile", str(chain.mesh), "--config", settings("profile", profile)],
        "export-sofa": ["export", "sofa", str(chain.mesh), "--config", settings("export", SIMULATION)],
        "import-sofa": [
            "import", "sofa", str(recordings(chain, folder)), "--mesh", str(chain.mesh), "--positions",
            str(folder / "positions.txt"), "--paper-constants",
        ],
        "assess": [
            "assess", str(save_bundle(block_predictor(), folder / "bundle")), "--poses", "1", "--depth", "1",
            "--finer", "quadratic", "--threads", "1",
        ],
    }
    assert set(commands) == set(NAMES)
    outs = {"dataset": None, "predict": "answer.vtu"}
    return {name: Verb(name, tuple(words), out=outs.get(name, "out")) for name, words in commands.items()}


def recordings(chain, folder):
    """The toy simulations as SOFA's recorder writes them."""
    store, out = SimulationStore.open(chain.simulation / "store"), folder / "recordings"
    out.mkdir()
    for pose in store.poses:
        found = store.load(pose)
        np.savez(
            out / f"{pose.name}.npz", displacement_um=np.round(found.displacement * 1e3).astype(np.int16),
            contact_offsets=found.contact_offsets.astype(np.int32), contact_nodes=found.contact_nodes.astype(np.int32),
            contact_forces_mN=(found.contact_forces * 1e3).astype(np.float32),
            contact_probe_position=found.path.translations.astype(np.float32),
            rotation_deg=np.float32(pose.rotation_deg), position_index=np.int32(pose.position_index),
        )
    np.savetxt(folder / "positions.txt", store.positions)
    return out


@pytest.fixture
def undisturbed(verbs, tmp_path_factory):
    """Folder of a run of a verb that was left alone, and how long it took [s]; each is made once."""

    def get(name):
        if name not in _made:
            folder = tmp_path_factory.mktemp(name)
            seconds, said = whole(verbs[name], folder)
            (folder / "said.txt").write_text(said)
            _made[name] = folder, seconds
        return _made[name]

    return get


_made = {}


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")
@pytest.mark.parametrize("name", NAMES)
def test_a_killed_command_goes_on(verbs, undisturbed, pace, name, tmp_path):
    reference, seconds = undisturbed(name)
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    began = time.monotonic()
    wrong = killed(verbs[name], reference, tmp_path, kinds=KINDS, seconds=seconds, pace=pace, rng=rng)
    passed = time.monotonic() - began
    print(f"{name}: {len(KINDS)} kills; {seconds:.1f} s alone, {passed:.0f} s with all kills; {len(wrong)} wrong")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", NAMES)
def test_a_command_twice_at_once(verbs, undisturbed, pace, name, tmp_path):
    reference, seconds = undisturbed(name)
    wrong = two_at_once(verbs[name], reference, tmp_path, patience=pace.patience(seconds))
    assert not wrong, "\n".join(wrong)
