"""A real browser on a small body: a server of the toy block, Chromium without a window, and what the page shows."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.live_page import ARGUMENTS, find_chromium
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.press.domain import PoseDomain
from mixpinn.press.error_law import PoseErrorLaw
from mixpinn.server.gate import Door
from mixpinn.server.run import LiveServer
from mixpinn.serving import HybridPredictor
from server.page.screen import Screen
from serving.live.pressed import UP, block_predictor


@pytest.fixture(scope="session")
def predictor() -> HybridPredictor:
    """The toy block under a small sphere, with a calibration that was made up."""
    bare = block_predictor()
    assert bare.pose is not None
    coefficients = np.zeros((3, 8))
    coefficients[:, 0], coefficients[:, 1] = np.log([0.05, 0.4, 0.07]), 0.5
    law = PoseErrorLaw(coefficients, np.array([2.0, 2.5, 2.2]), 0.95)
    ball = bare.pose.contact.field(spherical_probe(radius=7.0, subdivisions=3))
    pose = replace(bare.pose, probes=(ball,), domain=PoseDomain.of_mesh(bare.mesh, deepest=8.0), error=law)
    predictor = HybridPredictor(replace(bare.model, name="block"), pose=pose)
    # Kernels are compiled here, and not while a page waits for an answer.
    touching = [20.0, UP - 1.0, 20.0]
    predictor.press([touching, [20.0, UP + 20.0, 30.0]], history=predictor.press([touching, touching]).history)
    return predictor


@pytest.fixture(scope="module")
def server(predictor: HybridPredictor) -> Iterator[LiveServer]:
    """A server of the block on a free port."""
    with LiveServer(predictor, Door(port=0)) as server:
        yield server


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Chromium; skips where it is absent. Ends with its module: it holds the thread's event loop."""
    found = find_chromium()
    if found is None:
        pytest.skip("no Chromium: install it (apt-get install chromium) or set MIXPINN_CHROMIUM")
    playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright: pip install playwright")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=found, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def screen(browser, server: LiveServer, tmp_path: Path) -> Iterator[Screen]:
    """The page, open and connected; after the test: no errors, and no request beyond the server."""
    screen = Screen(browser, server.url, downloads=tmp_path)
    yield screen
    screen.close()
    assert screen.complaints == []
    assert screen.foreign == []
