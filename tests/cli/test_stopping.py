"""Signals are taken where they can be: not while Numba looks at arguments, nor while machine code is loaded."""

import signal
import time
from importlib.machinery import ExtensionFileLoader

import pytest

from mixpinn.cli import stopping


@pytest.fixture
def heard():
    """Signals as the command line hears them, for this test alone."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    stopping.hear_signals()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def whole(number):
    """Something that goes on to its end, whatever comes."""
    signal.raise_signal(number)
    return "whole"


class Loader(ExtensionFileLoader):
    """One that imports Python while it loads."""

    def create_module(self, spec):
        return whole(spec)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts(heard, number):
    with pytest.raises(KeyboardInterrupt):
        whole(number)
    assert stopping.exit_code() == 128 + number


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("where", ["arguments", "loading"])
def test_where_it_would_be_overlooked_it_comes_again(heard, number, where):
    if where == "arguments":
        names = {"__name__": "numba.core.typing.typeof"}
        exec("def unsafe(number): return inner(number)\ndef inner(number): return signal(number)", names)
        exec("import signal as s\ndef signal(number):\n    s.raise_signal(number)\n    return 'whole'", names)
        unsafe = names["unsafe"]
    else:
        unsafe = Loader("name", "path").create_module
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (the first statement must end)
        assert unsafe(number) == "whole"
        time.sleep(5.0)
    assert stopping.exit_code() == 128 + number


def test_what_takes_too_long_is_interrupted_all_the_same(heard, monkeypatch):
    monkeypatch.setattr(stopping, "_LONGEST", 0.0)
    with pytest.raises(KeyboardInterrupt):
        Loader("name", "path").create_module(signal.SIGTERM)


def test_a_signal_that_is_ignored_stays_so(monkeypatch):
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        stopping.hear_signals()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
