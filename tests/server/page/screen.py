"""Screen: one open page, what it shows, and how to reach for it."""

from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray

# The newest pose has been answered, picture and numbers are those of the answer.
_SETTLED = """() => {
  const m = window.mixpinn;
  return Boolean(m?.stage.answer) && !m.stage.pace.pending && !m.link.waiting.size && m.link.nextId > 1
    && Math.max(...m.stage.answer.probes.map((probe) => probe.poseId)) === m.link.nextId - 1
    && Number(document.getElementById("force").dataset.sequence) === m.stage.answer.sequence;
}"""


class Screen:
    """A page in a context of its own.

    Attributes:
        page: of Playwright.
        complaints: errors and warnings of the console, and exceptions.
        foreign: addresses beyond the server that were asked for.
    """

    def __init__(self, browser: Any, url: str, *, downloads: Path, size: tuple[int, int] = (1280, 720), **context: Any):
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **context)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.foreign: list[str] = []
        self.downloads, self._url = downloads, url
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", self._watch)
        self.page.goto(url)
        self.settle()

    def close(self) -> None:
        self.context.close()

    def settle(self) -> None:
        """Wait until the page shows the answer to the newest pose."""
        self.page.wait_for_function(_SETTLED, timeout=60_000)

    def wait(self, expression: str, seconds: float = 60.0) -> None:
        """Until a JavaScript expression is true; `m` as in `value`."""
        # A function: the page's own rules forbid evaluating text.
        condition = f"() => {{ const m = window.mixpinn; return {expression}; }}"
        self.page.wait_for_function(condition, timeout=1e3 * seconds)

    def text(self, name: str) -> str:
        """What an element shows."""
        return self.page.locator(f"#{name}").inner_text().strip()

    def number(self, name: str) -> float:
        """The first number of an element."""
        return float(self.text(name).split()[0])

    def value(self, expression: str) -> Any:
        """Of JavaScript, with `m` for the page's own objects."""
        return self.page.evaluate(f"(() => {{ const m = window.mixpinn; return {expression}; }})()")

    def probes(self) -> list[dict[str, Any]]:
        """The probes of the shown answer."""
        found: list[dict[str, Any]] = self.value("m.stage.answer.probes")
        return found

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Tips (k, 3) [mm] and rotations (k, 3, 3) of the shown answer."""
        probes = self.probes()
        return (
            np.array([probe["tip"] for probe in probes]),
            np.array([probe["rotation"] for probe in probes]).reshape(-1, 3, 3),
        )

    def motions(self) -> FloatArray:
        """The table of motions: way [mm] and angle [degree] of each part, shape (K, 2)."""
        rows = self.page.locator("#motions tr").all()
        return np.array([[float(cell) for cell in row.locator("td").all_inner_texts()[1:]] for row in rows])

    def set_slider(self, name: str, value: float) -> None:
        """Move a slider as its keys and the mouse do, and wait for the answer."""
        slider = self.page.locator(f"#{name}")
        slider.fill(str(value))
        self.settle()

    def tick(self, name: str, on: bool) -> None:
        """Set a box and wait for the answer."""
        self.page.locator(f"#{name}").set_checked(on)
        self.settle()

    def pixel(self, point: Any) -> tuple[float, float]:
        """Where a point of the world is seen in the window."""
        box = self.page.locator("#canvas").bounding_box()
        seen = np.array(self.value("Array.from(m.stage.camera.matrix)")).reshape(4, 4).T @ [*point, 1.0]
        x, y = seen[:2] / seen[3]
        return box["x"] + (x + 1.0) / 2.0 * box["width"], box["y"] + (1.0 - y) / 2.0 * box["height"]

    def ray(self, x: float, y: float) -> tuple[FloatArray, FloatArray]:
        """Origin and direction of what is seen at a place of the window, from the inverse of the camera's matrix."""
        box = self.page.locator("#canvas").bounding_box()
        inverse = np.linalg.inv(np.array(self.value("Array.from(m.stage.camera.matrix)")).reshape(4, 4).T)
        place = [2.0 * (x - box["x"]) / box["width"] - 1.0, 1.0 - 2.0 * (y - box["y"]) / box["height"]]
        near, far = (inverse @ [*place, depth, 1.0] for depth in (-1.0, 1.0))
        near, far = near[:3] / near[3], far[:3] / far[3]
        return near, (far - near) / np.linalg.norm(far - near)

    def screenshot(self) -> FloatArray:
        """The picture of the stage alone, RGB from 0 to 1."""
        from io import BytesIO

        from matplotlib.image import imread

        self.page.evaluate("window.mixpinn.stage.ask()")
        self.page.wait_for_timeout(120)
        return imread(BytesIO(self.page.locator("#canvas").screenshot()))[..., :3]

    def download(self, button: str) -> Path:
        """Press a button and take the file that comes."""
        with self.page.expect_download() as coming:
            self.page.locator(f"#{button}").click()
        path = self.downloads / coming.value.suggested_filename
        coming.value.save_as(path)
        return path

    def _hear(self, said: Any) -> None:
        # Chromium without a graphics card fetches each picture from WebGL itself, and warns of its own doing.
        if said.type in ("error", "warning") and "GPU stall due to ReadPixels" not in said.text:
            self.complaints.append(said.text)

    def _watch(self, request: Any) -> None:
        if not request.url.startswith((self._url, self._url.replace("http", "ws"), "blob:", "data:")):
            self.foreign.append(request.url)
