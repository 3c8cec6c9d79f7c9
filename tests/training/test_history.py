"""The loss curve is read back to the last bit."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mixpinn.base.errors import InputError
from mixpinn.networks.checkpoint import MODEL_FILE, NETWORK
from mixpinn.training import EpochRecord, read_history
from mixpinn.training.history import HISTORY_FILE, write_history

finite = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.builds(EpochRecord, st.integers(1, 999), finite, finite, finite, finite), max_size=5))
def test_round_trip(tmp_path: Path, history: list[EpochRecord]) -> None:
    write_history(tmp_path, history)
    assert read_history(tmp_path) == tuple(history)


def test_one_that_was_altered_is_refused(tmp_path: Path) -> None:
    """Its checksum stands in the network's manifest, which is written anew with it."""
    (tmp_path / MODEL_FILE).write_text("{}")
    NETWORK.seal(tmp_path, [MODEL_FILE])
    for losses in (2.5, 1.25), (2.5, 1.25, 1.125):
        write_history(tmp_path, [EpochRecord(k, loss, loss, 1e-3, 1.0) for k, loss in enumerate(losses, start=1)])
        assert len(read_history(tmp_path)) == len(losses)
    NETWORK.check(tmp_path)
    path = tmp_path / HISTORY_FILE
    path.write_text(path.read_text().replace("1.25", "1.24"))
    with pytest.raises(InputError, match="altered after it was made"):
        read_history(tmp_path)


def test_absent_and_damaged_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_history(tmp_path)
    (tmp_path / HISTORY_FILE).write_text("epoch,train_loss\n1,a\n")
    with pytest.raises(InputError, match="one row of numbers"):
        read_history(tmp_path)
