"""Views, recordings and files, two people at once, a server that goes and comes back, small screens, light and dark."""

import csv
import json
import zipfile

import numpy as np
import pyvista as pv
from numpy.testing import assert_allclose

from mixpinn.server.gate import Door
from mixpinn.server.run import LiveServer
from server.page.screen import Screen


def test_skin_and_cut_show_what_lies_inside(screen) -> None:
    screen.page.locator("#colour").select_option("none")
    pictures = {}
    for opacity in (0, 50, 100):
        screen.page.locator("#skin").fill(str(opacity))
        assert screen.text("skin-value") == f"{opacity} %"
        pictures[opacity] = screen.screenshot()
    part = np.array([20.0, 20.0, 15.0])
    x, y = screen.pixel(part)
    box = screen.page.locator("#canvas").bounding_box()
    column, row = round(x - box["x"]), round(y - box["y"])
    around = np.s_[row - 3 : row + 4, column - 3 : column + 4]
    seen = {opacity: picture[around].mean(axis=(0, 1)) for opacity, picture in pictures.items()}
    # Half-clear skin lies between nothing and the whole of it.
    low, high = np.minimum(seen[0], seen[100]), np.maximum(seen[0], seen[100])
    assert (seen[50] > low - 0.06).all()
    assert (seen[50] < high + 0.06).all()
    assert np.abs(seen[0] - seen[100]).max() > 0.1
    for kind, axis, name in (("sagittal", 0, "x"), ("coronal", 1, "y"), ("axial", 2, "z")):
        screen.page.locator("#cut").select_option(kind)
        screen.page.locator("#cut-at").fill("50")
        assert screen.text("cut-value") == "20 mm", name
        assert np.abs(screen.screenshot() - pictures[100]).mean() > 0.003
        plane = np.array(screen.value("m.stage.cut.plane(m.stage.camera.eye)"))
        assert abs(plane[axis] * 20.0 + plane[3]) < 1e-6
    screen.page.locator("#cut").select_option("coronal")
    hit = screen.value(f"m.stage.pick({x}, {y}).skin")
    assert hit is None or hit["point"][1] <= 20.0 + 1e-3  # what is cut away is not met


def test_a_cut_shows_the_tissue_inside_as_it_stands(screen, predictor) -> None:
    screen.tick("friction", False)
    screen.set_slider("depth", 5)
    screen.page.locator("#cut").select_option("sagittal")
    screen.wait("m.stage.answer.inner && m.stage.section?.count")
    screen.settle()
    tips, rotations = screen.poses()
    mesh, field = predictor.mesh, predictor.press(tips, rotation=rotations).displacement[: predictor.mesh.n_points]
    cells = mesh.cells[mesh.deforming_cells]
    body = pv.UnstructuredGrid({pv.CellType.TETRA: cells}, mesh.points + field)
    body["moved"] = np.linalg.norm(field, axis=1)
    at = screen.value("m.stage.cut.at")
    expected = body.slice(normal="x", origin=(at, 0.0, 0.0)).cell_data_to_point_data().point_data_to_cell_data()
    expected = expected.compute_cell_sizes(length=False, volume=False)
    size = screen.value("m.stage.section.count")
    corners = np.array(screen.value(f"Array.from(m.stage.section.positions.slice(0, {3 * size}))")).reshape(-1, 3, 3)
    assert_allclose(corners[..., 0], at, atol=1e-4)
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert_allclose(areas.sum(), expected["Area"].sum(), rtol=1e-3)
    values = np.array(screen.value(f"Array.from(m.stage.section.values.slice(0, {size}))")).reshape(-1, 3).mean(axis=1)
    assert_allclose(areas @ values, expected["Area"] @ expected["moved"], rtol=1e-2)
    assert values.max() > 0.5
    # Where there is tissue in the plane, nothing else is seen.
    screen.page.locator("#colour").select_option("none")
    for button in ("side", "home"):
        screen.page.locator(f"#{button}").click()
    screen.page.locator("#side").click()
    picture, box = screen.screenshot(), screen.page.locator("#canvas").bounding_box()
    x, y = screen.pixel(corners[areas.argmax()].mean(axis=0))
    red, green, blue = picture[round(y - box["y"]), round(x - box["x"])]
    assert red > green > blue  # flesh
    screen.page.locator("#cut").select_option("none")
    screen.set_slider("depth", 2)
    assert screen.value("m.stage.answer.inner") is None  # what is not seen is not sent


def test_record_replay_and_save(screen, predictor) -> None:
    screen.tick("friction", False)
    screen.page.locator("#record").click()
    screen.wait("document.getElementById('record').getAttribute('aria-pressed') === 'true'")
    for depth in (1, 2, 3, 3.5):  # a whole number of steps of the path would be a matter of rounding
        screen.set_slider("depth", depth)
    force = screen.number("force")
    screen.page.locator("#record").click()
    screen.wait("!document.getElementById('replay').disabled")
    count = int(screen.text("recorded"))
    assert count >= 4

    screen.set_slider("depth", 0)
    screen.page.locator("#replay").click()
    screen.wait("document.getElementById('replay').textContent === 'Replay' && m.stage.answer.kind === 2")
    screen.wait(f"document.getElementById('force').textContent === '{force:.2f}'")
    assert_allclose(screen.probes()[0]["depth"], 3.5, atol=1e-3)

    screen.page.locator("#save-kind").select_option("csv")
    with screen.download("save").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == count
    last = rows[-1]
    assert_allclose(np.linalg.norm([float(last[f"force_{axis}"]) for axis in "xyz"]), force, atol=0.00502)
    tip = [float(last[f"tip_{axis}"]) for axis in "xyz"]
    rotation = np.reshape([float(last[f"r{i}{j}"]) for i in range(3) for j in range(3)], (3, 3))
    answer = predictor.press(tip, rotation=rotation)
    assert_allclose([float(last[f"force_{axis}"]) for axis in "xyz"], answer.force, atol=1e-4)

    screen.page.locator("#save-kind").select_option("pvd")
    with zipfile.ZipFile(screen.download("save")) as series:
        series.extractall(screen.downloads)
        index = next(name for name in series.namelist() if name.endswith(".pvd"))
    reader = pv.get_reader(screen.downloads / index)
    assert len(reader.time_values) == count
    reader.set_active_time_value(reader.time_values[-1])
    assert_allclose(reader.read()[0]["displacement"], answer.displacement, atol=1e-4)

    screen.page.locator("#save-kind").select_option("vtu")
    screen.set_slider("depth", 2.5)
    tips, rotations = screen.poses()
    saved = pv.read(screen.download("save"))
    assert_allclose(saved["displacement"], predictor.press(tips, rotation=rotations).displacement, atol=1e-4)


def test_a_screenshot_is_the_picture_of_the_stage(screen) -> None:
    from matplotlib.image import imread

    picture = imread(screen.download("screenshot"))
    box = screen.page.locator("#canvas").bounding_box()
    assert picture.shape[1] / picture.shape[0] == round(2 * box["width"]) / round(2 * box["height"])
    assert picture[..., :3].std() > 0.02


def test_two_browsers_each_have_their_own_probe(screen, browser, server, predictor, tmp_path) -> None:
    other = Screen(browser, server.url, downloads=tmp_path)
    for one in (screen, other):
        one.tick("friction", False)
    screen.set_slider("depth", 2)
    other.set_slider("depth", 5)
    other.page.mouse.click(*other.pixel((10.0, 40.0, 30.0)))
    other.settle()
    for one, depth in ((screen, 2.0), (other, 5.0)):
        tips, rotations = one.poses()
        assert_allclose(one.probes()[0]["depth"], depth, atol=1e-3)
        force = np.linalg.norm(predictor.press(tips, rotation=rotations).force)
        assert_allclose(one.number("force"), force, atol=0.00502)
    assert np.linalg.norm(screen.poses()[0] - other.poses()[0]) > 5.0
    other.close()
    assert other.complaints == other.foreign == []


def test_the_page_says_when_the_server_is_gone_and_comes_back(browser, predictor, tmp_path) -> None:
    first = LiveServer(predictor, Door(port=0))
    first.start()
    screen = Screen(browser, first.url, downloads=tmp_path)
    screen.set_slider("depth", 3)
    first.stop()
    screen.page.wait_for_selector("#status[data-state=closed]")
    assert "cannot be reached" in screen.text("notice")
    assert "mixpinn view" in screen.text("notice")
    with LiveServer(predictor, Door(port=first.door.port)):
        screen.page.wait_for_selector("#status[data-state=open]")
        screen.settle()
        assert not screen.page.locator("#notice").is_visible()
        assert_allclose(screen.probes()[0]["depth"], 3.0, atol=1e-3)  # what was wanted is wanted still
        screen.close()
    assert screen.foreign == []


def test_a_refused_pose_is_explained_and_the_next_one_answered(screen) -> None:
    screen.value("m.link.send({type: 'skin', id: m.link.nextId++, probe: 0, point: [500, 500, 500], depth: 1})")
    screen.page.wait_for_selector("#notice:visible")
    assert "To mend it: " in screen.text("notice")
    screen.set_slider("depth", 1)
    assert not screen.page.locator("#notice").is_visible()


def test_a_page_of_another_protocol_is_told_so(browser, server, tmp_path) -> None:
    context = browser.new_context()
    page = context.new_page()
    page.route("**/api/scene.json", lambda route: route.fulfill(body=json.dumps({"version": 7})))
    page.goto(server.url)
    page.wait_for_selector("#notice:visible")
    assert "version 7" in page.locator("#notice").inner_text()
    assert page.locator("#status").inner_text() == "Not ready"
    context.close()


def test_light_and_dark_follow_the_system_and_the_switch(browser, server, tmp_path) -> None:
    def ground(screen):
        return screen.page.evaluate("getComputedStyle(document.body).backgroundColor")

    dark = Screen(browser, server.url, downloads=tmp_path, color_scheme="dark")
    assert dark.screenshot()[5, 5].max() < 0.2  # the picture's own ground goes along
    night = ground(dark)
    dark.page.locator("#theme").click()
    assert ground(dark) != night
    assert dark.screenshot()[5, 5].min() > 0.8
    dark.page.reload()
    dark.settle()
    assert ground(dark) != night  # the choice is kept
    dark.close()
    assert dark.complaints == []


def test_a_low_screen_scrolls_and_a_usual_one_does_not(browser, server, tmp_path) -> None:
    for height, scrolls in ((720, False), (560, True)):
        screen = Screen(browser, server.url, downloads=tmp_path, size=(1280, height))
        tall = screen.page.evaluate("document.documentElement.scrollHeight")
        assert (tall > height) is scrolls
        screen.page.locator("#screenshot").scroll_into_view_if_needed()
        box = screen.page.locator("#screenshot").bounding_box()
        assert box["y"] + box["height"] <= height, height
        # Nothing is cut off at the sides, and no panel hides what it holds.
        assert screen.page.evaluate("document.documentElement.scrollWidth") <= 1280
        for panel in screen.page.locator(".panel").all():
            assert panel.evaluate("(one) => one.scrollHeight <= one.clientHeight + 1")
        screen.close()
