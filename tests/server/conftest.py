"""A server of the toy bundle."""

from collections.abc import Iterator

import pytest

from mixpinn.server.gate import Door
from mixpinn.server.limits import Limits
from mixpinn.server.run import LiveServer
from serving.live.pressed import above, block_predictor

LIMITS = Limits(clients=6, rate=1_000.0, burst=1_500.0, hello_s=1.0, request_s=1.0, send_s=1.5, may_leave_s=0.5)


@pytest.fixture(scope="session")
def predictor():
    """A predictor of the block that takes poses."""
    found = block_predictor()
    found.press(above(depth=2.0).translation)  # compiles, which no client of a test waits for
    return found


@pytest.fixture(scope="module")
def server(predictor) -> Iterator[LiveServer]:
    """A server with short time limits."""
    with LiveServer(predictor, Door(port=0), limits=LIMITS) as running:
        yield running
