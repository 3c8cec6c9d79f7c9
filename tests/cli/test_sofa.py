"""Scenes to SOFA and recordings from SOFA through the command line."""

import shutil

import numpy as np
import pytest

from mixpinn.dataset import SimulationStore
from pipeline.chain import command, done


@pytest.fixture
def recordings(chain, tmp_path):
    """The toy simulations written as SOFA's recorder writes them, and the list of their positions."""
    store = SimulationStore.open(chain.simulation / "store")
    folder = tmp_path / "recordings"
    folder.mkdir()
    for pose in store.poses:
        simulation = store.load(pose)
        np.savez(
            folder / f"{pose.name}.npz", displacement_um=np.round(simulation.displacement * 1e3).astype(np.int16),
            contact_offsets=simulation.contact_offsets.astype(np.int32),
            contact_nodes=simulation.contact_nodes.astype(np.int32),
            contact_forces_mN=(simulation.contact_forces * 1e3).astype(np.float32),
            contact_probe_position=simulation.path.translations.astype(np.float32),
            rotation_deg=np.float32(pose.rotation_deg), position_index=np.int32(pose.position_index),
        )
    np.savetxt(tmp_path / "positions.txt", store.positions)
    return folder


def test_recordings_become_simulations_that_are_evaluated(chain, recordings, tmp_path):
    words = [
        "import", "sofa", recordings, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt", "--out",
        tmp_path / "s", "--paper-constants",
    ]
    done(*words)
    mine, own = SimulationStore.open(tmp_path / "s" / "store"), SimulationStore.open(chain.simulation / "store")
    first, second = mine.load(mine.poses[1]), own.load(own.poses[1])
    np.testing.assert_allclose(first.displacement, second.displacement, atol=5.1e-4)
    done(*words)
    done("evaluate", tmp_path / "s", chain.model, "--no-pictures", "--out", tmp_path / "e")
    assert "μ = 8.758621 kPa" in (tmp_path / "e" / "report.html").read_text()


def test_positions_of_other_recordings_are_refused(chain, recordings, tmp_path):
    (tmp_path / "positions.txt").write_text("0 0 0\n")
    outcome = command(
        "import", "sofa", recordings, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt", "--out",
        tmp_path / "s", "--paper-constants",
    )
    assert outcome.code == 2
    assert "6 or more positions" in outcome.lines[-1]
    assert not (tmp_path / "s").exists()


def test_export_writes_a_scene(chain, tmp_path):
    words = ["export", "sofa", chain.mesh, "--config", chain.settings("simulate"), "--out", tmp_path / "scene"]
    done(*words)
    compile((tmp_path / "scene" / "scene.py").read_text(), "scene.py", "exec")
    outcome = command(*words[:-1], tmp_path / "other", "--set", "tissue.energy=linear")
    assert outcome.code == 2
    assert "'stable'" in outcome.lines[-1]


def test_import_continues_a_store_that_was_cut_short(chain, recordings, tmp_path):
    words = [
        "import", "sofa", recordings, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt", "--out",
        tmp_path / "s", "--paper-constants",
    ]
    done(*words)
    record = tmp_path / "s" / "run.json"
    record.write_text(record.read_text().replace('"finished"', '"interrupted"'))
    shutil.rmtree(tmp_path / "s" / "store" / "pose_002_000")
    done(*words)
    assert [status.state for status in SimulationStore.open(tmp_path / "s" / "store").statuses()] == ["done"] * 6


def test_unknown_constants_are_refused_with_the_remedy(chain, recordings, tmp_path):
    words = [
        "import", "sofa", recordings, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt", "--out",
        tmp_path / "s",
    ]
    outcome = command(*words)
    assert outcome.code == 2
    assert "--paper-constants" in outcome.lines[-1]
    assert "contact" in outcome.lines[-1]
    assert not (tmp_path / "s").exists()
    outcome = command(*words, "--set", "tissue.mu=8.0")
    assert outcome.code == 2
    assert "lam" in outcome.lines[-1]
    assert not (tmp_path / "s").exists()


def test_constants_come_from_the_exported_scene(chain, recordings, tmp_path):
    scene = tmp_path / "scene"
    done("export", "sofa", chain.mesh, "--config", chain.settings("simulate"), "--out", scene)
    done(
        "import", "sofa", recordings, "--mesh", chain.mesh, "--positions", tmp_path / "positions.txt", "--out",
        tmp_path / "s", "--scene", scene,
    )
    mine, own = SimulationStore.open(tmp_path / "s" / "store"), SimulationStore.open(chain.simulation / "store")
    for a, b in zip(mine.materials(), own.materials(), strict=True):
        assert type(a) is type(b)
        assert (a.mu, a.lam) == pytest.approx((b.mu, b.lam), rel=1e-12)
    assert (mine.contact().gap, mine.contact().friction) == (own.contact().gap, own.contact().friction)
