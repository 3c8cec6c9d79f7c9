"""Shared fixtures: where the real data lies, if it is there; how long the drills are."""

import os
from pathlib import Path

import pytest

from mixpinn.training import settle_arithmetic

settle_arithmetic()  # before any test uses the sparse solver: trainings are compared to the last bit

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--drill", action="store_true", help="long drills and examples at full size: see 'make drill'")


@pytest.fixture(scope="session")
def drill(request: pytest.FixtureRequest) -> bool:
    """Whether this is the long version, of `make drill`."""
    return bool(request.config.getoption("--drill"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real patient and the reference fields; skips where it is absent."""
    folder = Path(os.environ.get("MIXPINN_DATA", ROOT / ".." / "shared" / "data")).resolve()
    if not (folder / "patient1").is_dir():
        pytest.skip(f"no real data at {folder}: set MIXPINN_DATA")
    return folder
