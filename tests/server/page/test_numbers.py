"""The numbers on the page are those of the Python interface, to the last digit that is shown."""

import threading

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.serving.live.comparison import Setup, solve_fully
from mixpinn.serving.live.error_field import error_field
from mixpinn.serving.live.skin import SkinPlacement

# Half of the last digit, and as much more as float32 on the way can shift a number across it.
TWO, THREE = 0.00502, 0.000502


def asked(predictor, screen):
    """The Python interface's answer to what the page asks for, from the places on the skin on."""
    skin = SkinPlacement(predictor.pose)
    poses = [
        skin.place(
            wish["point"], depth=wish["depth"], turn_deg=wish["turn"], tilt_deg=(wish["tiltDown"], -wish["tiltRight"]),
        ) for wish in screen.value("m.probes.wishes")
    ]
    return predictor.press([pose.translation for pose in poses], rotation=[pose.rotation for pose in poses])


def check_numbers(predictor, screen, active: int = 0) -> None:
    answer = asked(predictor, screen)
    assert_allclose(screen.number("force"), np.linalg.norm(answer.force[active]), atol=TWO)
    shown = np.array(screen.text("force-vector").split(), dtype=float)
    assert_allclose(shown, answer.force[active], atol=TWO)
    motions = answer.motions.values()
    assert_allclose(screen.motions(), [[m.distance, m.angle_deg] for m in motions], atol=TWO)
    assert_allclose(screen.number("expected"), answer.trust.expected, atol=THREE)
    assert_allclose(screen.number("bound"), answer.trust.bound, atol=THREE)
    assert_allclose(screen.number("force-bound"), answer.trust.force_bound, atol=TWO)


@pytest.fixture
def straight(screen):
    """A page whose friction does not remember the way, so that an answer is a function of the pose alone."""
    screen.tick("friction", False)
    return screen


def test_sliders_press_turn_and_tilt_the_probe(straight, predictor) -> None:
    straight.set_slider("depth", 4.5)
    straight.set_slider("spin", 35)
    straight.set_slider("tilt-right", 6)
    straight.set_slider("tilt-down", -9)
    wish = straight.value("m.probes.current")
    pose = SkinPlacement(predictor.pose).place(wish["point"], depth=4.5, turn_deg=35.0, tilt_deg=(-9.0, -6.0))
    tips, rotations = straight.poses()
    assert_allclose(tips[0], pose.translation, atol=1e-4)
    assert_allclose(rotations[0], pose.rotation, atol=1e-6)
    shaft = rotations[0] @ [0.0, 1.0, 0.0]
    assert shaft[0] > 0.0  # the shaft leans to the patient's right, x
    assert shaft[2] < 0.0  # and to the head, −z
    assert straight.text("depth-value") == "4.5 mm"
    assert straight.text("spin-value") == "35°"
    assert_allclose(np.array(straight.text("tip").split()[:3], dtype=float), tips[0], atol=0.0502)
    assert straight.number("force") > 0.5
    check_numbers(predictor, straight)


def test_a_second_probe_presses_too(straight, predictor) -> None:
    straight.set_slider("depth", 3)
    straight.tick("second", True)
    straight.set_slider("depth", 2)
    assert straight.page.locator("#probe-2").is_checked()
    assert [probe["index"] for probe in straight.probes()] == [0, 1]
    check_numbers(predictor, straight, active=1)
    other = np.linalg.norm(asked(predictor, straight).force[0])
    assert_allclose(straight.number("force-second"), other, atol=TWO)
    straight.page.locator("#probe-1").check(force=True)
    straight.settle()
    assert_allclose(straight.number("force"), other, atol=TWO)
    straight.page.locator("#second").uncheck()
    straight.wait("m.stage.answer.probes.length === 1")
    straight.page.wait_for_selector("#force-other", state="hidden")


def test_trust_speaks_plainly_outside_of_what_was_learned(straight, predictor) -> None:
    straight.set_slider("depth", 3)
    assert straight.text("verdict") == "Within what the model has learned."
    straight.set_slider("depth", 9.5)
    verdict = straight.text("verdict")
    assert verdict.startswith("Outside of what the model has learned: ")
    reasons = asked(predictor, straight).trust.reasons
    assert reasons
    assert all(reason in verdict for reason in reasons)
    check_numbers(predictor, straight)
    straight.page.locator("#lift").click()
    straight.settle()
    assert straight.text("depth-value") == "0.0 mm"


def test_colours_are_of_displacement_or_expected_error(straight, predictor) -> None:
    straight.set_slider("depth", 5)
    mesh, answer = predictor.mesh, asked(predictor, straight)
    skin = np.unique(mesh.skin_triangles)
    size = np.linalg.norm(answer.displacement[skin], axis=1)
    assert_allclose(straight.value("Array.from(m.stage.values)"), size, atol=1e-3)  # sent in steps of 0.001 mm
    ticks = [float(tick) for tick in straight.text("legend-ticks").split()]
    assert ticks[0] == 0.0
    assert ticks[-1] >= size.max() > 0.3 * ticks[-1]
    assert straight.text("legend-title") == "Displacement [mm]"
    straight.page.locator("#colour").select_option("error")
    errors = error_field(answer)[skin]
    assert_allclose(straight.value("Array.from(m.stage.values)"), errors, atol=2e-4)
    assert straight.text("legend-title") == "Expected error [mm]"
    assert float(straight.text("legend-ticks").split()[-1]) >= errors.max()
    straight.page.locator("#colour").select_option("none")
    assert not straight.page.locator("#legend").is_visible()


def test_friction_remembers_the_way_where_it_is_asked_to(screen, predictor) -> None:
    screen.set_slider("depth", 4)
    screen.page.locator("#canvas").focus()
    for _ in range(3):
        screen.page.keyboard.press("ArrowRight")
        screen.settle()
    dragged = screen.number("force-vector")
    screen.tick("friction", False)
    check_numbers(predictor, screen)
    assert abs(dragged - screen.number("force-vector")) > 0.05


class InThread:
    """The full solution without a process of its own, which costs seconds; that one is tested with the server."""

    def __init__(self, setup, *, progress, finished) -> None:
        def solve():
            finished(solve_fully(setup, progress))

        threading.Thread(target=solve, daemon=True).start()

    def cancel(self) -> bool:
        return False


def test_the_full_solution_beside_the_model(straight, predictor, monkeypatch) -> None:
    monkeypatch.setattr("mixpinn.server.orders.FullSolution", InThread)
    straight.set_slider("depth", 3)
    answer = asked(predictor, straight)
    straight.page.locator("#compare").click()
    straight.wait("document.getElementById('compared').textContent.startsWith('Difference')", seconds=60.0)
    tips, rotations = straight.poses()
    full = solve_fully(Setup.of_predictor(predictor, [ProbePose(rotations[0], tips[0])]))
    difference = np.linalg.norm(full.displacement - answer.displacement, axis=1)
    lines = straight.text("compared").splitlines()
    words = lines[0].replace(",", "").split()
    assert_allclose(float(words[2]), difference.mean(), atol=THREE)
    assert_allclose(float(words[5]), difference.max(), atol=TWO)
    words = lines[1].replace(",", "").split()
    assert_allclose(float(words[1]), np.linalg.norm(full.force), atol=TWO)
    assert_allclose(float(words[4]), np.linalg.norm(answer.force), atol=TWO)
    skin = np.unique(predictor.mesh.skin_triangles)
    assert straight.page.locator("#colour").input_value() == "difference"
    assert_allclose(straight.value("Array.from(m.stage.values)"), difference[skin], atol=2.5e-3)
    straight.set_slider("depth", 2)  # another pose: nothing is known of its difference
    assert straight.page.locator("#colour").input_value() == "displacement"


def test_two_probes_are_compared_where_they_press_in_the_same_direction(straight, predictor, monkeypatch) -> None:
    monkeypatch.setattr("mixpinn.server.orders.FullSolution", InThread)
    straight.set_slider("depth", 1.5)
    straight.tick("second", True)
    straight.set_slider("depth", 1)
    straight.set_slider("tilt-right", 5)
    straight.page.locator("#compare").click()
    straight.wait("document.getElementById('compared').textContent.includes('same direction')")
    straight.page.locator("#straight").click()
    straight.settle()
    straight.page.locator("#compare").click()
    straight.wait("document.getElementById('compared').textContent.startsWith('Difference')", seconds=60.0)
    tips, rotations = straight.poses()
    full = solve_fully(Setup.of_predictor(predictor, [ProbePose(*pose) for pose in zip(rotations, tips, strict=True)]))
    words = straight.text("compared").splitlines()[1].replace(",", "").split()
    assert_allclose(float(words[1]), np.linalg.norm(full.force.sum(axis=0)), atol=TWO)
    assert_allclose(float(words[4]), np.linalg.norm(asked(predictor, straight).force.sum(axis=0)), atol=TWO)


def test_a_comparison_goes_on_while_the_probe_moves_and_says_that_it_has(straight, monkeypatch) -> None:
    moved = threading.Event()

    def held(setup, *, progress, finished):
        return InThread(setup, progress=progress, finished=lambda found: moved.wait(60.0) and finished(found))

    monkeypatch.setattr("mixpinn.server.orders.FullSolution", held)
    straight.set_slider("depth", 2)
    straight.page.locator("#compare").click()
    straight.page.evaluate("window.mixpinn.link.send({ type: 'skin', id: 0, point: [900, 0, 0], depth: 2 })")
    straight.wait("!document.getElementById('notice').hidden")  # that pose was refused
    assert straight.text("compare") == "Stop"
    straight.set_slider("depth", 3)
    moved.set()
    straight.wait("document.getElementById('compared').textContent.startsWith('Difference')", seconds=60.0)
    assert straight.text("compared").splitlines()[-1].startswith("The probe has moved since")
    assert straight.page.locator("#colour [value=difference]").is_disabled()
