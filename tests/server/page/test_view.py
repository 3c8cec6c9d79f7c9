"""What is seen: the gauge, the frame rate, colours of the rigid parts, nearer and farther; commands by single keys."""

import threading

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.server.scene import part_colour
from mixpinn.serving.live.comparison import solve_fully


def test_the_gauge_is_as_long_as_the_force(screen, predictor) -> None:
    screen.tick("friction", False)
    for depth in (2, 5):
        screen.set_slider("depth", depth)
        tips, rotations = screen.poses()
        force = np.linalg.norm(predictor.press(tips, rotation=rotations).force)
        full = screen.page.locator(".gauge").bounding_box()["width"]
        assert screen.text("gauge-end") == f"{screen.number('gauge-end'):g} N"
        assert screen.number("gauge-end") >= force
        wanted = force / screen.number("gauge-end")
        length = "document.getElementById('gauge').getBoundingClientRect().width"
        screen.wait(f"Math.abs({length} / {full} - {wanted}) < 0.01", 10.0)  # it glides there


def test_the_frame_rate_is_that_of_the_pictures_drawn(screen) -> None:
    screen.page.evaluate(
        "new Promise((done) => { let left = 30; const { stage } = window.mixpinn;"
        " const again = () => { stage.ask(); if (left--) setTimeout(again, 50); else done(); }; again(); })"
    )
    screen.wait("/^\\d+ pictures\\/s/.test(document.getElementById('rate').textContent)", seconds=5.0)
    assert 2 <= int(screen.text("rate").split()[0]) <= 61
    assert screen.text("rate").endswith(" ms")


def test_rigid_parts_have_the_colours_of_their_rows(screen, predictor) -> None:
    count = predictor.mesh.n_parts
    for k in range(count):
        colour = np.array([int(part_colour(k, count)[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        assert_allclose(screen.value(f"Array.from(m.stage.parts[{k}].colour)"), colour, atol=1e-6)
        dot = screen.page.locator("#motions i").nth(k).evaluate("(one) => getComputedStyle(one).backgroundColor")
        assert_allclose(np.array(dot[4:-1].split(","), dtype=float) / 255.0, colour, atol=1e-6)


def test_nearer_farther_and_back(screen) -> None:
    first = screen.value("m.stage.camera.distance")
    screen.page.locator("#zoom-in").click()
    assert_allclose(screen.value("m.stage.camera.distance"), 0.85 * first)
    screen.page.locator("#zoom-out").click()
    screen.page.locator("#zoom-out").click()
    assert_allclose(screen.value("m.stage.camera.distance"), first / 0.85)
    screen.page.locator("#home").click()
    assert_allclose(screen.value("m.stage.camera.distance"), first)


def test_single_keys_record_replay_and_compare(screen, monkeypatch) -> None:
    begun = threading.Event()

    def solution(setup, *, progress, finished):
        begun.set()
        threading.Thread(target=lambda: finished(solve_fully(setup, progress)), daemon=True).start()

    monkeypatch.setattr("mixpinn.server.orders.FullSolution", solution)
    press = screen.page.keyboard.press
    screen.page.locator("#canvas").focus()
    press("r")
    screen.wait("document.getElementById('record').getAttribute('aria-pressed') === 'true'")
    for _ in range(3):
        press("PageDown")
        screen.settle()
    press("r")
    screen.wait("!document.getElementById('replay').disabled")
    assert int(screen.text("recorded")) == 3
    press("p")
    screen.wait("m.stage.answer.kind === 2 && document.getElementById('replay').textContent === 'Replay'")
    assert screen.probes()[0]["depth"] == pytest.approx(1.5, abs=1e-3)
    press("c")
    screen.wait("document.getElementById('compared').textContent.startsWith('Difference')")
    assert begun.is_set()
