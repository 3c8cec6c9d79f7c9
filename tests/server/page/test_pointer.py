"""Mouse and keys move the probe over the deformed skin, and it lies where the pointer was."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.geometry.probe_pose import probe_rotation


def meet(points, triangles, origin, direction):
    """Where a ray first meets triangles, by solving origin + t d = a + u (b − a) + v (c − a) for each."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    system = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=-1)
    good = np.abs(np.linalg.det(system)) > 1e-9
    u, v, t = np.linalg.solve(system[good], (origin - a[good])[..., None])[..., 0].T
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t > 0.0)
    return origin + t[inside].min() * direction if inside.any() else None


def shown_skin(predictor, screen):
    """The skin as it is on the page, from the Python interface's answer to the poses there."""
    mesh, (tips, rotations) = predictor.mesh, screen.poses()
    answer = predictor.press(tips, rotation=rotations)
    return mesh.points + answer.displacement[:mesh.n_points], mesh.skin_faces


def distance_from_axis(screen, point, probe=0):
    tips, rotations = screen.poses()
    away = np.asarray(point) - tips[probe]
    axis = rotations[probe] @ [0.0, 1.0, 0.0]
    return np.linalg.norm(away - (away @ axis) * axis)


@pytest.fixture
def pressed(screen):
    """A page with the probe pressed in by 4 mm, where friction does not remember the way."""
    screen.tick("friction", False)
    screen.set_slider("depth", 4)
    return screen


@pytest.mark.parametrize("place", [(12.0, 40.0, 14.0), (26.0, 39.0, 27.0)])
def test_a_click_puts_the_probe_on_the_skin_under_the_pointer(pressed, predictor, place) -> None:
    x, y = pressed.pixel(place)
    under = meet(*shown_skin(predictor, pressed), *pressed.ray(x, y))
    pressed.page.mouse.click(x, y)
    pressed.settle()
    assert distance_from_axis(pressed, under) < 0.05
    assert_allclose(pressed.probes()[0]["depth"], 4.0, atol=1e-3)


def test_the_probe_follows_the_pointer_over_the_deformed_skin(pressed, predictor) -> None:
    tips, rotations = pressed.poses()
    axis = rotations[0] @ [0.0, 1.0, 0.0]
    top = meet(*shown_skin(predictor, pressed), tips[0] + 1000.0 * axis, -axis)
    grip = np.array(pressed.pixel(tips[0] + 12.0 * axis))  # the upper end of the sphere
    offset = np.array(pressed.pixel(top)) - grip
    pressed.page.mouse.move(*grip)
    pressed.page.mouse.down()
    for way in ([12.0, 4.0], [25.0, -10.0], [-20.0, -25.0]):
        before = shown_skin(predictor, pressed)
        pressed.page.mouse.move(*(grip + way))
        pressed.settle()
        under = meet(*before, *pressed.ray(*(grip + way + offset)))
        assert distance_from_axis(pressed, under) < 0.05
    pressed.page.mouse.up()
    there = pressed.poses()[0]
    pressed.page.mouse.move(*grip)  # without the button nothing moves
    assert_allclose(pressed.poses()[0], there)


def test_the_wheel_presses_and_with_ctrl_it_zooms(pressed) -> None:
    pressed.page.mouse.move(*pressed.pixel((20.0, 40.0, 20.0)))
    pressed.page.mouse.wheel(0, 200)
    pressed.settle()
    assert_allclose(pressed.probes()[0]["depth"], 5.0, atol=1e-3)
    assert pressed.text("depth-value") == "5.0 mm"
    pressed.page.mouse.wheel(0, -100)
    pressed.settle()
    assert_allclose(pressed.probes()[0]["depth"], 4.5, atol=1e-3)
    before = pressed.value("m.stage.camera.distance")
    pressed.page.keyboard.down("Control")
    pressed.page.mouse.wheel(0, -200)
    pressed.page.keyboard.up("Control")
    pressed.wait(f"m.stage.camera.distance < {before}")
    assert_allclose(pressed.probes()[0]["depth"], 4.5, atol=1e-3)


def test_dragging_beside_the_probe_turns_the_view_alone(pressed) -> None:
    pose, eye = pressed.poses(), pressed.value("m.stage.camera.eye")
    x, y = pressed.pixel((4.0, 30.0, 38.0))
    pressed.page.mouse.move(x, y)
    pressed.page.mouse.down()
    pressed.page.mouse.move(x + 60, y + 20, steps=3)
    pressed.page.mouse.up()
    assert np.linalg.norm(np.subtract(pressed.value("m.stage.camera.eye"), eye)) > 10.0
    assert_allclose(pressed.poses()[0], pose[0])
    before = pressed.value("m.stage.camera.target")
    pressed.page.mouse.move(x, y)
    pressed.page.mouse.down(button="right")
    pressed.page.mouse.move(x + 30, y, steps=2)
    pressed.page.mouse.up(button="right")
    assert np.linalg.norm(np.subtract(pressed.value("m.stage.camera.target"), before)) > 1.0
    pressed.page.locator("#side").click()
    pressed.page.wait_for_timeout(150)
    edges = {edge.get_attribute("data-edge"): edge.inner_text() for edge in pressed.page.locator(".edge").all()}
    pressed.page.locator("#home").click()
    pressed.page.wait_for_timeout(150)
    home = {edge.get_attribute("data-edge"): edge.inner_text() for edge in pressed.page.locator(".edge").all()}
    assert home == {"top": "Cranial", "bottom": "Caudal", "left": "Left", "right": "Right"}
    assert {edges["left"], edges["right"]} == {"Posterior", "Anterior"}


def test_handles_turn_and_tilt(pressed) -> None:
    spin, tilt = (pressed.page.locator(f"#handle-{name}").bounding_box() for name in ("spin", "tilt"))
    centre = np.array(pressed.pixel(pressed.poses()[0][0]))
    start = np.array([spin["x"] + 9.0, spin["y"] + 9.0])
    pressed.page.mouse.move(*start)
    pressed.page.mouse.down()
    away = start - centre
    there = centre + np.array([-away[1], away[0]])
    pressed.page.mouse.move(*there, steps=4)
    pressed.page.mouse.up()
    pressed.settle()
    turn = pressed.value("m.probes.current.turn")
    assert 60.0 < abs(turn) < 120.0
    assert_allclose(pressed.poses()[1][0], probe_rotation(turn), atol=1e-6)
    # The handle went with the pointer, not the other way round: it points to where that meets its plane.
    (tip,), (rotation,) = pressed.poses()
    origin, direction = pressed.ray(*there)
    met = origin + (tip[1] - origin[1]) / direction[1] * direction - tip
    assert_allclose(rotation @ [1.0, 0.0, 0.0], met / np.linalg.norm(met), atol=0.03)
    pressed.page.locator("#straight").click()
    pressed.settle()
    assert_allclose(pressed.poses()[1][0], np.eye(3), atol=1e-6)
    pressed.page.mouse.move(tilt["x"] + 9.0, tilt["y"] + 9.0)
    pressed.page.mouse.down()
    pressed.page.mouse.move(tilt["x"] + 39.0, tilt["y"] + 9.0, steps=3)
    pressed.page.mouse.up()
    pressed.settle()
    assert pressed.poses()[1][0][0, 1] > 0.05  # the shaft leans to the right, as the pointer went
    seen = pressed.page.locator("#handle-tilt").bounding_box()
    assert abs(seen["x"] - tilt["x"] - 30.0) < 4.0


def test_the_keyboard_alone_does_it_all(pressed) -> None:
    press = pressed.page.keyboard.press
    pressed.page.locator("#canvas").focus()
    right, top = (np.array(pressed.value(f"m.stage.camera.{name}")) for name in ("right", "top"))

    def change(*keys):
        before = pressed.poses()[0][0]
        for key in keys:
            press(key)
            pressed.settle()
        return pressed.poses()[0][0] - before

    moved = change("ArrowRight", "ArrowRight")
    across, along = right[[0, 2]] / np.linalg.norm(right[[0, 2]]), moved[[0, 2]] / np.linalg.norm(moved[[0, 2]])
    assert_allclose(along, across, atol=0.1)
    assert 3.0 < np.linalg.norm(moved) < 5.5
    moved = change("ArrowUp")
    assert moved @ top > 1.0
    press("ArrowDown")
    press("ArrowLeft")
    pressed.settle()
    change("Shift+PageDown", "PageUp")
    assert_allclose(pressed.probes()[0]["depth"], 5.5, atol=1e-3)
    change("e", "e", "q", "d", "s", "s", "w", "a")
    assert pressed.value("[m.probes.current.turn, m.probes.current.tiltRight, m.probes.current.tiltDown]") == [5, 0, 2]
    before = pressed.value("[m.stage.camera.azimuth, m.stage.camera.distance]")
    for key in ("j", "i", "+", "Shift+L"):
        press(key)
    after = pressed.value("[m.stage.camera.azimuth, m.stage.camera.distance]")
    assert before[0] != after[0]
    assert before[1] > after[1]
    press("2")
    pressed.settle()
    assert len(pressed.probes()) == 2
    press("1")
    press("?")
    assert pressed.page.locator("#help").is_visible()
    press("Escape")
    assert not pressed.page.locator("#help").is_visible()


def test_every_control_is_reached_by_tab_and_shows_the_focus(screen) -> None:
    names = screen.page.evaluate(
        "[...document.querySelectorAll('button, select, input, canvas, [tabindex]')]"
        ".filter((one) => !one.disabled && one.checkVisibility() && !one.closest('dialog'))"
        ".map((one) => one.id || one.className)"
    )
    screen.page.evaluate("document.activeElement.blur()")
    seen = []
    for _ in range(len(names) + 2):
        screen.page.keyboard.press("Tab")
        seen.append(screen.page.evaluate("document.activeElement.id || document.activeElement.className"))
        if seen[-1] in ("canvas", "compare", "handle-tilt", "depth"):
            outline = screen.page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
            assert outline == "solid"
    assert set(names) <= set(seen)
    screen.page.locator("#handle-tilt").focus()
    screen.page.keyboard.press("ArrowRight")
    screen.page.locator("#handle-spin").focus()
    screen.page.keyboard.press("ArrowRight")
    screen.settle()
    assert screen.value("[m.probes.current.tiltRight, m.probes.current.turn]") == [2, 5]
