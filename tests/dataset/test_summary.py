import pytest

from dataset.dataset_fakes import FakeScene, block, filled_store, short_store
from mixpinn.dataset import GenerationSummary, summarise


def test_totals(tmp_path):
    store = filled_store(tmp_path, FakeScene(block(3), trouble={0: "raise", 1: "unconverged"}))
    store.discard(store.poses[-1])
    summary = summarise(store, wall_seconds=2.0, workers=2)
    assert (summary.poses, summary.done, summary.failed, summary.missing) == (6, 3, 2, 1)
    assert summary.steps == 3 * 6
    assert summary.contact_steps == 2 + 2 + 4
    assert summary.failed_steps == 4
    assert summary.iterations == 3 * 18
    assert summary.solve_seconds == pytest.approx(9.0)
    assert summary.reasons == {"SolveError: no equilibrium": 2}
    # Only converged steps count: depth 2 at most at position 1, depth 4 at position 2.
    assert summary.min_jacobian == (pytest.approx(0.96), "pose_002_000")
    assert summary.worst_residual == (pytest.approx(3e-8), "pose_002_000")
    assert summary.peak_energy == (pytest.approx(16.0), "pose_002_000")
    assert summary.peak_penetration[0] == pytest.approx(0.01)
    assert "| Poses done | 3 of 6 |" in summary.markdown()


def test_round_trip_also_of_an_empty_store(tmp_path):
    summary = summarise(short_store(tmp_path, FakeScene(block(3))))
    assert summary.min_jacobian is None
    summary.save(tmp_path / "summary.json")
    assert GenerationSummary.load(tmp_path / "summary.json") == summary
    assert "unknown" in summary.markdown()
