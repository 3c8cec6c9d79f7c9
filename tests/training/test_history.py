"""The loss curve is read back to the last bit."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mixpinn.base.errors import InputError
from mixpinn.training import EpochRecord, read_history
from mixpinn.training.history import HISTORY_FILE, write_history

finite = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.builds(EpochRecord, st.integers(1, 999), finite, finite, finite, finite), max_size=5))
def test_round_trip(tmp_path: Path, history: list[EpochRecord]) -> None:
    write_history(tmp_path, history)
    assert read_history(tmp_path) == tuple(history)


def test_absent_and_damaged_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_history(tmp_path)
    (tmp_path / HISTORY_FILE).write_text("epoch,train_loss\n1,a\n")
    with pytest.raises(InputError, match="one row of numbers"):
        read_history(tmp_path)
