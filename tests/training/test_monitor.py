"""TensorBoard's log holds one point an epoch, also after an epoch was repeated."""

import time
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from mixpinn.training import EpochRecord
from mixpinn.training.monitor import EpochLog


def test_a_repeated_epoch_replaces_its_point(tmp_path: Path) -> None:
    with EpochLog(tmp_path, first_epoch=1) as log:
        log.add(EpochRecord(1, 1.0, 2.0, 5e-4, 0.1))
        log.add(EpochRecord(2, 9.0, 9.0, 5e-4, 0.1))
    time.sleep(1.1)  # TensorBoard reads its files by name, which begins with the second that they were made in
    with EpochLog(tmp_path, first_epoch=2) as log:
        log.add(EpochRecord(2, 0.5, 1.5, 5e-4, 0.1))
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    points = [(event.step, event.value) for event in events.Scalars("loss/train")]
    assert points == [(1, 1.0), (2, 0.5)]
    assert [event.value for event in events.Scalars("loss/validation")] == [2.0, 1.5]
