// The two handles at the active probe: one to turn it about its axis, one to tilt it. They are buttons, so that Tab
// reaches them and arrow keys move them.

import { along, cross, dot, normalize, scale, subtract, turn } from "./linear.js";
import { onPlane } from "./pointer.js";

const RING = 40; // points of the drawn circle

export class Handles {
  /**
   * @param {import("./stage.js").Stage} stage
   * @param {import("./probes.js").Probes} probes
   */
  constructor(stage, probes) {
    this.stage = stage;
    this.probes = probes;
    this.spin = document.getElementById("handle-spin");
    this.tilt = document.getElementById("handle-tilt");
    this.lines = document.getElementById("lines");
    const { low, high } = extent(stage.scene.probe.points);
    this.radius = 1.25 * Math.max(high[0], -low[0]);
    this.height = high[1] + 0.35 * (high[1] - low[1]);
    this.#drag(this.spin, (ray, probe, start) => {
      const angle = this.#angle(ray, probe);
      if (angle === null) return;
      start.angle ??= angle;
      start.turn ??= probes.current.turn;
      probes.set({ turn: start.turn + angle - start.angle });
    });
    this.#drag(this.tilt, (ray, probe) => {
      probes.tiltTowards(probe.tip, onSphere(ray, probe.tip, this.height));
    });
    this.#keys(this.spin, { ArrowLeft: ["turn", -5], ArrowRight: ["turn", 5] });
    this.#keys(this.tilt, {
      ArrowLeft: ["tiltRight", -2], ArrowRight: ["tiltRight", 2], ArrowUp: ["tiltDown", -2], ArrowDown: ["tiltDown", 2],
    });
    stage.addEventListener("drawn", () => this.#follow());
  }

  get #probe() {
    return this.stage.answer?.probes.find((one) => one.index === this.probes.active);
  }

  #at({ rotation, tip }, point) {
    const p = turn(rotation, point);
    return [p[0] + tip[0], p[1] + tip[1], p[2] + tip[2]];
  }

  /** Angle of the pointer about the probe's axis [degree], in the probe's sense of rotation but not its own turn. */
  #angle(ray, probe) {
    const axis = [probe.rotation[1], probe.rotation[4], probe.rotation[7]]; // +y of the probe
    const place = onPlane(ray, probe.tip, axis);
    if (!place) return null;
    const away = subtract(place, probe.tip);
    const first = normalize(cross(axis, [0, 0, 1])), second = cross(first, axis);
    return (Math.atan2(dot(away, second), dot(away, first)) * -180) / Math.PI;
  }

  #drag(handle, move) {
    let start = null;
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      start = {};
      this.#moveTo(event, move, start);
    });
    handle.addEventListener("pointermove", (event) => start && this.#moveTo(event, move, start));
    for (const end of ["pointerup", "pointercancel"]) handle.addEventListener(end, () => { start = null; });
  }

  #moveTo(event, move, start) {
    const { stage } = this;
    if (this.#probe) move(stage.camera.ray(...stage.toView(event.clientX, event.clientY)), this.#probe, start);
  }

  #keys(handle, steps) {
    handle.addEventListener("keydown", (event) => {
      const step = steps[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      this.probes.set({ [step[0]]: this.probes.current[step[0]] + step[1] });
    });
  }

  /** Put handles and lines where the picture shows the probe. */
  #follow() {
    const probe = this.#probe;
    for (const handle of [this.spin, this.tilt]) handle.hidden = !probe;
    const paths = [];
    const probes = this.stage.answer?.probes ?? [];
    for (const one of probes) {
      paths.push(...this.#arrow(one));
      if (probes.length > 1) paths.push(this.#number(one));
    }
    if (probe) {
      const ring = [];
      for (let i = 0; i <= RING; i++) {
        const angle = (2 * Math.PI * i) / RING;
        ring.push(this.#at(probe, [this.radius * Math.cos(angle), 0, this.radius * Math.sin(angle)]));
      }
      paths.push(this.#path(ring), this.#path([this.#at(probe, [0, 0, 0]), this.#at(probe, [0, this.height, 0])]));
      this.#put(this.spin, this.#at(probe, [this.radius, 0, 0]));
      this.#put(this.tilt, this.#at(probe, [0, this.height, 0]));
    }
    this.lines.innerHTML = paths.join("");
  }

  #put(handle, point) {
    const { x, y } = this.stage.toStage(point);
    handle.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }

  #path(points) {
    const places = points.map((point) => this.stage.toStage(point));
    return `<path d="M${places.map(({ x, y }) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}"/>`;
  }

  /** Which probe this is, beside it. */
  #number(probe) {
    const { x, y } = this.stage.toStage(this.#at(probe, [-this.radius, 0.4 * this.height, 0]));
    return `<text x="${x.toFixed(1)}" y="${(y + 5).toFixed(1)}">${probe.index + 1}</text>`;
  }

  /** The force on a probe as an arrow from its tip, 2 mm a newton. */
  #arrow({ tip, force }) {
    const size = Math.hypot(...force);
    if (size < 0.05) return [];
    const end = [0, 1, 2].map((k) => tip[k] + 2 * force[k]);
    const from = this.stage.toStage(tip), to = this.stage.toStage(end);
    const long = Math.hypot(to.x - from.x, to.y - from.y);
    if (long < 6) return [];
    const u = [(to.x - from.x) / long, (to.y - from.y) / long], h = Math.min(10, long);
    const base = [to.x - h * u[0], to.y - h * u[1]], w = 0.45 * h;
    const corner = (side) => `${(base[0] - side * w * u[1]).toFixed(1)} ${(base[1] + side * w * u[0]).toFixed(1)}`;
    return [
      `<path class="force" d="M${from.x.toFixed(1)} ${from.y.toFixed(1)}L${base[0].toFixed(1)} ${base[1].toFixed(1)}"/>`,
      `<path class="head" d="M${to.x.toFixed(1)} ${to.y.toFixed(1)}L${corner(1)}L${corner(-1)}Z"/>`,
    ];
  }
}

/** Where a ray first meets the sphere on which the handle goes; beside it the nearest place on the ray. */
function onSphere({ origin, direction }, centre, radius) {
  const away = subtract(origin, centre), middle = dot(away, direction);
  const inside = middle * middle - dot(away, away) + radius * radius;
  return along(origin, direction, -middle - Math.sqrt(Math.max(inside, 0)));
}

function extent(points) {
  const low = [Infinity, Infinity, Infinity], high = scale(low, -1);
  points.forEach((value, i) => {
    low[i % 3] = Math.min(low[i % 3], value);
    high[i % 3] = Math.max(high[i % 3], value);
  });
  return { low, high };
}
