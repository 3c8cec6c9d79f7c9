// Where the user wants each probe: a place of the skin, how deep beyond first touch, and how it is turned and tilted.

import { along, dot, normalize, scale, subtract } from "./linear.js";
import { meet } from "./picking.js";

const DEGREE = Math.PI / 180;
export const LIMITS = { depth: [-10, 24], turn: [-180, 180], tilt: [-40, 40] };

/** One probe; the server makes a pose of it. */
class Wish {
  constructor(point) {
    this.point = point; // on the skin [mm]
    this.depth = 0; // beyond first touch of the skin at rest [mm]
    this.turn = 0; // about its axis [degree]
    this.tiltRight = 0; // of the shaft, to the patient's right [degree]
    this.tiltDown = 0; // of the shaft, to the feet [degree]
  }
}

/** Dispatches `wish` when what the user wants has changed; the detail is the probe's index. */
export class Probes extends EventTarget {
  /** @param {import("./stage.js").Stage} stage */
  constructor(stage) {
    super();
    this.stage = stage;
    this.direction = stage.scene.direction;
    this.wishes = [new Wish(this.#middle())];
    this.active = 0;
  }

  get current() { return this.wishes[this.active]; }

  /** Set some of depth, turn, tiltRight, tiltDown of the active probe, each within its limits. */
  set(changes) {
    for (const [name, value] of Object.entries(changes)) {
      const [low, high] = LIMITS[name.startsWith("tilt") ? "tilt" : name];
      // A turn goes round.
      this.current[name] = name === "turn" ? ((value + 540) % 360) - 180 : Math.min(high, Math.max(low, value));
    }
    this.#changed();
  }

  /** Put the active probe on a place of the deformed skin. */
  place(point) {
    this.current.point = point;
    this.#changed();
  }

  /**
   * Move the active probe by (right, up) in the picture [mm] and back onto the skin.
   *
   * @returns {boolean} whether there is skin
   */
  step(right, up) {
    const { camera, skin } = this.stage;
    const moved = along(along(this.current.point, camera.right, right), camera.top, up);
    const origin = along(moved, this.direction, -1000);
    const hit = meet(skin.points, skin.triangles, { origin, direction: this.direction });
    if (!hit) return false;
    this.place(hit.point);
    return true;
  }

  /** Choose which probe the controls move; the second one comes when it is first chosen. */
  choose(index) {
    if (index >= this.wishes.length) {
      const first = this.wishes[0].point, { low, high } = this.stage.scene.bounds;
      // Towards whichever end of the body is farther away, well inside of it.
      const feet = high[2] - first[2], head = first[2] - low[2];
      const down = feet > head ? Math.min(45, 0.6 * feet) : -Math.min(45, 0.6 * head);
      this.wishes.push(new Wish([first[0], first[1], first[2] + down]));
      this.active = index;
      if (!this.step(0, 0)) this.#changed();
    }
    this.active = index;
    this.dispatchEvent(new Event("chosen"));
  }

  /** Take the second probe away. */
  dismiss() {
    this.wishes.length = 1;
    this.active = 0;
    this.dispatchEvent(new CustomEvent("dismiss", { detail: 1 }));
    this.dispatchEvent(new Event("chosen"));
  }

  /** Lean the shaft of the active probe from its tip towards a point. */
  tiltTowards(tip, point) {
    const wanted = normalize(subtract(point, tip)), rest = scale(this.direction, -1);
    if (dot(wanted, rest) < 0.1) return;
    const feet = (v) => Math.asin(Math.max(-1, Math.min(1, v[2]))), right = (v) => Math.atan2(v[0], v[1]);
    this.set({
      tiltDown: (feet(wanted) - feet(rest)) / DEGREE, tiltRight: (right(wanted) - right(rest)) / DEGREE,
    });
  }

  /** All wishes once more, for a server that does not know them. */
  repeat() {
    this.wishes.forEach((_, index) => this.dispatchEvent(new CustomEvent("wish", { detail: index })));
  }

  #changed() {
    this.dispatchEvent(new CustomEvent("wish", { detail: this.active }));
  }

  /** The skin behind the middle of the rigid parts. */
  #middle() {
    const { scene, skin } = this.stage;
    const sum = [0, 0, 0];
    let count = 0;
    for (const { points } of scene.parts) {
      for (let i = 0; i < points.length; i += 3) {
        for (let k = 0; k < 3; k++) sum[k] += points[i + k];
        count += 1;
      }
    }
    const { low, high } = scene.bounds;
    const middle = count ? scale(sum, 1 / count) : [0, 1, 2].map((k) => (low[k] + high[k]) / 2);
    const origin = along(middle, this.direction, -1000);
    return meet(skin.rest, skin.triangles, { origin, direction: this.direction })?.point ?? middle;
  }
}
