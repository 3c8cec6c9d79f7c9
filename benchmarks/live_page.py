"""How fast the page is: pictures a second, and from a probe that was moved to the picture that shows its answer."""

import os
import shutil
from typing import Any
from urllib.parse import urlsplit

import numpy as np

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# What Chromium does by itself where there is no graphics card: the processor puts the page together, and draws WebGL,
# which has to be allowed; the sandbox needs rights that containers do not give. (With --use-angle=swiftshader it takes
# SwiftShader for a graphics card and has it put the page together too, at twice the cost.)
ARGUMENTS = ["--enable-unsafe-swiftshader", "--no-sandbox"]
_NOTHING = {"pictures_per_s": None, "drag_to_picture_ms_p95": None, "external_requests": None}
# A picture counts when its pixels are there: one of them is read back. The probe goes along an ellipse
# over what the bundle learned to press, at 40 mm a second or less, however fast the machine is.
_DRAG = """async ([seconds, low, high]) => {
  const m = window.mixpinn, { stage, link, probes } = m;
  const gl = document.getElementById("canvas").getContext("webgl2"), pixel = new Uint8Array(4);
  const sent = new Map(), delays = [], pictures = [];
  const send = link.send.bind(link), draw = stage.pace.draw;
  let shown = 0;
  link.send = (message) => {
    if (message.id !== undefined) sent.set(message.id, performance.now());
    send(message);
  };
  stage.pace.draw = (scale) => {
    const answer = stage.answer;
    draw(scale);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    const now = performance.now();
    pictures.push(now);
    if (!answer || answer.poseId === shown) return;
    shown = answer.poseId;
    if (sent.has(shown)) delays.push(now - sent.get(shown));
  };
  const half = low.map((at, k) => (high[k] - at) / 2);
  const began = performance.now();
  let before = began, angle = 0;
  await new Promise((resolve) => {
    const step = () => {
      const now = performance.now();
      if (now - began > 1000 * seconds) { resolve(); return; }
      angle += 40 / Math.max(...half) * (now - before) / 1000;
      before = now;
      const x = low[0] + half[0] * (1 + 0.8 * Math.sin(angle)), z = low[1] + half[1] * (1 - 0.8 * Math.cos(angle));
      probes.current.depth = 10 + 5 * Math.sin(2 * angle);
      probes.current.point = [x, probes.current.point[1], z];
      probes.step(0, 0); // onto the skin as it is now
      setTimeout(step, 16);
    };
    step();
  });
  link.send = send;
  stage.pace.draw = draw;
  return { pictures: pictures.length, seconds: (performance.now() - began) / 1000, delays };
}"""


def find_chromium() -> str | None:
    """Path of Chromium or Chrome: what ``MIXPINN_CHROMIUM`` says, or the first that is installed."""
    return os.environ.get("MIXPINN_CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)


def drag_on_page(url: str, seconds: float) -> dict[str, Any]:
    """Drag the probe over the page in a Chromium without a window.

    Args:
        url: of the server.
        seconds: how long; 0 measures nothing.
    """
    chromium = find_chromium()
    if chromium is None or not seconds:
        return _NOTHING
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return _NOTHING
    foreign: list[str] = []
    complaints: list[str] = []
    own = urlsplit(url).netloc
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.on("request", lambda request: foreign.append(request.url) if _foreign(request.url, own) else None)
        page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        page.wait_for_function("() => window.mixpinn?.stage.answer", timeout=60_000)
        about = page.request.get(f"{url}/api/scene.json").json()["range"]
        page.evaluate(_DRAG, [min(seconds, 3.0), about["low"], about["high"]])  # warm
        found = page.evaluate(_DRAG, [seconds, about["low"], about["high"]])
        browser.close()
    delays = found["delays"]
    return {
        "pictures_per_s": found["pictures"] / found["seconds"],
        "drag_to_picture_ms_p95": float(np.percentile(delays, 95)) if delays else None,
        "drag_to_picture_ms_p50": float(np.percentile(delays, 50)) if delays else None,
        "external_requests": len(foreign), "console_errors": len(complaints),
    }


def _foreign(url: str, own: str) -> bool:
    parts = urlsplit(url)
    return parts.scheme in ("http", "https", "ws", "wss") and parts.netloc != own
