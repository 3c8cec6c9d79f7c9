"""Orders of one client: what is told when one fails, and that a refused one costs nothing."""

import pytest

from mixpinn.base.errors import InputError
from mixpinn.server.limits import Limits
from mixpinn.server.messages import Order
from mixpinn.server.orders import ClientOrders
from mixpinn.server.service import Service
from mixpinn.serving.live import LiveSession
from serving.live.pressed import above, block_predictor

SAVE = Order("save", {"format": "vtu"})


class Told:
    """A client that keeps what it is told."""

    def __init__(self) -> None:
        self.messages = []

    def tell(self, message) -> None:
        self.messages.append(message)

    def show(self, found, kind) -> None:
        raise AssertionError("nothing is shown")


@pytest.fixture(scope="module")
def service():
    service = Service(block_predictor(), limits=Limits(saved=1))
    yield service
    service.close()


@pytest.fixture
def client(service):
    client = Told()
    with LiveSession(service.predictor, worker=service.worker) as session:
        session.press(above())
        client.orders = ClientOrders(client, session, service)
        yield client
        client.orders.close()


def _wait(orders) -> None:
    """Until nothing is being saved."""
    assert orders._saving.acquire(timeout=60.0)
    orders._saving.release()


def test_a_save_that_has_to_wait_takes_no_earlier_file_away(client, service) -> None:
    client.orders.obey(SAVE)
    _wait(client.orders)
    assert client.messages[0]["type"] == "saved"
    key, name = client.messages[0]["url"].split("/")[-2:]
    with client.orders._saving, pytest.raises(InputError, match="one file at a time"):
        client.orders.obey(SAVE)
    assert service.download(key, name).path.is_file()
    client.orders.obey(SAVE)
    _wait(client.orders)
    assert service.download(key, name) is None  # the newer one has its place


def test_a_client_is_told_of_an_error_that_nobody_foresaw(client, service, monkeypatch, caplog) -> None:
    monkeypatch.setattr(service, "offer", lambda name, write: 1 / 0)
    client.orders.obey(SAVE)
    _wait(client.orders)
    assert client.messages[0]["type"] == "error"
    assert "ZeroDivisionError" in client.messages[0]["got"]
    assert "save failed" in caplog.text


def test_a_client_is_told_when_a_comparison_fails(client, service, monkeypatch, caplog) -> None:
    ends = []

    def held(setup, *, progress, finished) -> None:
        ends.append(finished)

    monkeypatch.setattr("mixpinn.server.orders.FullSolution", held)
    client.orders.obey(Order("compare", {}))
    ends[0](None)  # no answer at all
    assert client.messages[0]["type"] == "error"
    assert "compare failed" in caplog.text
    assert service.comparing.acquire(blocking=False)  # others may compare again
    service.comparing.release()
