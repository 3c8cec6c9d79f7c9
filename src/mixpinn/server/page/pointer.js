// Mouse, pen and fingers on the picture: they move probes over the skin, press, and turn the view.

import { dot, scale, subtract } from "./linear.js";
import { meet } from "./picking.js";

const STILL = 4; // pixels: less is a click
const NOTCH = 0.5; // of the wheel [mm]

/**
 * @param {import("./stage.js").Stage} stage
 * @param {import("./probes.js").Probes} probes
 */
export function listenToPointer(stage, probes) {
  const { canvas, camera } = stage;
  const held = new Map(); // pointers that are down: where they are
  let action = null; // {kind: probe | orbit | pan | pinch, …}

  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (held.size === 2) {
      action = { kind: "pinch", ...spread(held) };
      return;
    }
    const start = { x: event.clientX, y: event.clientY, moved: false };
    if (event.button !== 0) action = { kind: "pan", ...start };
    else {
      const { probe } = stage.pick(event.clientX, event.clientY);
      if (probe) {
        if (probe.index !== probes.active) probes.choose(probe.index);
        action = { kind: "probe", ...start, offset: grip(stage, probe.index, event) };
      } else action = { kind: "orbit", ...start };
    }
  });

  canvas.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) {
      const { probe, skin } = stage.pick(event.clientX, event.clientY);
      canvas.dataset.over = probe ? "probe" : skin ? "skin" : "";
      return;
    }
    const [x, y] = held.get(event.pointerId), dx = event.clientX - x, dy = event.clientY - y;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (!action) return;
    if (Math.hypot(event.clientX - action.x, event.clientY - action.y) > STILL) action.moved = true;
    if (action.kind === "probe") {
      const { skin } = stage.pick(event.clientX + action.offset[0], event.clientY + action.offset[1]);
      if (skin?.front) probes.place(skin.point);
    } else if (action.kind === "pinch" && held.size === 2) {
      const now = spread(held);
      camera.zoom(action.size / now.size);
      camera.pan((now.x - action.x) / canvas.clientHeight, (action.y - now.y) / canvas.clientHeight);
      Object.assign(action, now);
      stage.ask();
    } else if (action.kind === "pan") {
      camera.pan(dx / canvas.clientHeight, -dy / canvas.clientHeight);
      stage.ask();
    } else if (action.kind === "orbit" && action.moved) {
      camera.orbit((3 * dx) / canvas.clientHeight, (3 * dy) / canvas.clientHeight);
      stage.ask();
    }
  });

  const release = (event) => {
    if (!held.delete(event.pointerId)) return;
    if (event.type === "pointerup" && action?.kind === "orbit" && !action.moved) {
      const { skin } = stage.pick(event.clientX, event.clientY);
      if (skin?.front) probes.place(skin.point);
    }
    action = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    // Browsers turn the wheel sideways with Shift, and send Ctrl for two fingers that spread on a touch pad.
    const turn = event.deltaY || event.deltaX;
    if (event.ctrlKey || event.shiftKey) {
      camera.zoom(Math.exp(0.0015 * turn));
      stage.ask();
    } else probes.set({ depth: probes.current.depth + NOTCH * Math.max(-4, Math.min(4, turn / 100)) });
  }, { passive: false });
}

/** From the pointer to where the probe's axis meets the skin, in pixels: a probe that is gripped does not jump. */
function grip(stage, index, event) {
  const probe = stage.answer.probes.find((one) => one.index === index);
  const direction = [-probe.rotation[1], -probe.rotation[4], -probe.rotation[7]];
  const origin = subtract(probe.tip, scale(direction, 1000));
  const hit = meet(stage.skin.points, stage.skin.triangles, { origin, direction });
  const box = stage.canvas.getBoundingClientRect(), at = stage.toStage(hit ? hit.point : probe.tip);
  return [at.x + box.left - event.clientX, at.y + box.top - event.clientY];
}

function spread(held) {
  const [[ax, ay], [bx, by]] = [...held.values()];
  return { x: (ax + bx) / 2, y: (ay + by) / 2, size: Math.max(1, Math.hypot(ax - bx, ay - by)) };
}

/** Where a ray meets the plane through `point` across `normal`. */
export function onPlane(ray, point, normal) {
  const slope = dot(ray.direction, normal);
  if (Math.abs(slope) < 1e-6) return null;
  const distance = dot(subtract(point, ray.origin), normal) / slope;
  return distance > 0 ? [0, 1, 2].map((k) => ray.origin[k] + distance * ray.direction[k]) : null;
}
