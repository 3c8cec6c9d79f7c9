"""Shared fixtures: where the real data lies, if it is there."""

import os
from pathlib import Path

import pytest

from mixpinn.training import settle_arithmetic

settle_arithmetic()  # before any test uses the sparse solver: trainings are compared to the last bit

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real patient and the reference fields; skips where it is absent."""
    folder = Path(os.environ.get("MIXPINN_DATA", ROOT / ".." / "shared" / "data")).resolve()
    if not (folder / "patient1").is_dir():
        pytest.skip(f"no real data at {folder}: set MIXPINN_DATA")
    return folder
