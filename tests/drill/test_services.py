"""Servers that are killed and stopped while they start and serve: they end in one line, and the port is free."""

import zlib

import numpy as np
import pytest

from drill.service_drill import Service, killed
from serving.live.pressed import block_predictor, save_bundle

KINDS = ("SIGTERM", "SIGINT", "SIGKILL", "SIGSTOP")


@pytest.fixture(scope="module", autouse=True)
def long(drill):
    if not drill:
        pytest.skip("only in 'make drill': a server that is interrupted while it serves is in tests/cli/test_live.py")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return save_bundle(block_predictor(), tmp_path_factory.mktemp("bundle"))


def service(name, bundle):
    page = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    if name == "stream":  # greets before it is asked
        return Service(name, (name, str(bundle)), b"", clean=False)
    words = (name, str(bundle), *(("--no-browser",) if name == "view" else ()))
    return Service(name, words, page, clean=True)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["serve", "view", "stream"])
def test_a_killed_server_ends_and_the_next_one_serves(bundle, name, kind, tmp_path):
    rng = np.random.default_rng(zlib.crc32(f"{name} {kind}".encode()))
    wrong = killed(service(name, bundle), bundle, tmp_path, kind=kind, rng=rng)
    print(f"{name}: {kind} while starting and while serving; {len(wrong)} wrong")
    assert not wrong, "\n".join(wrong)
