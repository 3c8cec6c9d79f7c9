// The body on the screen: surfaces, what moved them, how they are coloured, and the picture of all that.

import { Camera } from "./camera.js";
import { niceEnd, palette, rgb, SKIN } from "./colours.js";
import { Cut } from "./cut.js";
import { placement } from "./linear.js";
import { meet } from "./picking.js";
import { Pace } from "./pace.js";
import { Renderer } from "./renderer.js";
import { Section } from "./section.js";
import { Surface } from "./surface.js";

const PROBES = [rgb("#8e99a4"), rgb("#7d93a8")];
const INSIDE = rgb("#b98a78");
const TISSUES = ["#c98f7a", "#e3c27a", "#b5605c", "#d9a78f", "#8f6f86"].map(rgb);

/** Dispatches `drawn` after each picture, and `inside` (detail: whether) when what lies inside is to be seen or not. */
export class Stage extends EventTarget {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./scene.js").Scene} scene
   */
  constructor(canvas, scene) {
    super();
    this.canvas = canvas;
    this.scene = scene;
    this.renderer = new Renderer(canvas);
    this.skin = new Surface(scene.skin.points, scene.skin.triangles, 45);
    this.skinMesh = this.renderer.mesh(this.skin);
    this.parts = scene.parts.map((part) => ({
      mesh: this.renderer.mesh(new Surface(part.points, part.triangles, 60)), colour: rgb(part.colour),
    }));
    this.probeSurface = new Surface(scene.probe.points, scene.probe.triangles, 35);
    this.probeMesh = this.renderer.mesh(this.probeSurface);
    this.camera = new Camera(scene.bounds);
    this.cut = new Cut(scene.bounds);
    this.section = null; // the tissue that a cut shows, once there has been one
    this.opacity = 0.5;
    this.colour = "displacement";
    this.values = new Float32Array(scene.skin.points.length / 3);
    this.range = 1; // upper end of the legend [mm]
    this.answer = null;
    this.difference = this.innerDifference = null;
    this.ground = [1, 1, 1];
    this.pace = new Pace((scale) => this.#paint(scale));
    this.renderer.setPalette(palette(this.colour));
    new ResizeObserver(() => this.#fit()).observe(canvas);
    this.#fit();
    this.camera.home();
  }

  /** Show how the body stands. */
  show(answer) {
    this.answer = answer;
    const { points, rest } = this.skin;
    for (let i = 0; i < points.length; i++) points[i] = rest[i] + answer.displacement[i];
    this.skin.refresh();
    this.skinMesh.refresh();
    this.#recolour();
    this.ask();
  }

  /** The cut was moved: what lies inside is read when it is first seen. */
  async slice() {
    const seen = this.cut.kind !== "none";
    this.ask();
    if (seen && !this.section) {
      this.section = new Section(await this.scene.tissue());
      this.cloth = this.renderer.cloth(this.section);
    }
    this.dispatchEvent(new CustomEvent("inside", { detail: this.cut.kind !== "none" }));
    this.ask();
  }

  /** Colour by `displacement`, `error`, `difference` or `none`. */
  colourBy(name) {
    this.colour = name;
    if (name !== "none") this.renderer.setPalette(palette(name));
    this.range = 0;
    this.#recolour();
    this.ask();
  }

  /** Distances of the skin, and of all nodes, from another solution [mm], to be coloured by while the answer stays. */
  setDifference(values, inner = null) {
    this.difference = values;
    this.innerDifference = inner;
    this.#recolour();
    this.ask();
  }

  ask() {
    this.pace.ask();
  }

  /** Take the ground's colour from the page, when that has changed. */
  dress() {
    const ground = getComputedStyle(this.canvas.parentElement).backgroundColor.match(/[\d.]+/g).slice(0, 3);
    this.ground = ground.map((value) => value / 255);
    this.ask();
  }

  /** A place of the window as the camera takes it, from −1 to 1. */
  toView(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    return [2 * (clientX - box.left) / box.width - 1, 1 - 2 * (clientY - box.top) / box.height];
  }

  /** A point of the world in pixels of the stage. */
  toStage(point) {
    const { x, y, ahead } = this.camera.project(point);
    return { x: (x + 1) / 2 * this.canvas.clientWidth, y: (1 - y) / 2 * this.canvas.clientHeight, ahead };
  }

  /** What is seen at a place of the window: the skin as it is now, without what is cut away, or a probe. */
  pick(clientX, clientY) {
    const ray = this.camera.ray(...this.toView(clientX, clientY));
    const plane = this.cut.plane(this.camera.eye);
    const kept = plane && ((p) => plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3] <= 0);
    const skin = meet(this.skin.points, this.skin.triangles, ray, { kept });
    let probe = null;
    for (const one of this.answer?.probes ?? []) {
      const hit = meet(this.#probePoints(one), this.probeSurface.triangles, ray);
      if (hit && (!probe || hit.distance < probe.distance)) probe = { ...hit, index: one.index };
    }
    return { skin, probe: probe && (!skin || probe.distance < skin.distance) ? probe : null };
  }

  /** The picture as a PNG. */
  picture() {
    this.#paint(Math.max(2, this.pace.fine));
    return this.renderer.picture();
  }

  #probePoints({ rotation, tip }) {
    const r = rotation, rest = this.probeSurface.rest, out = new Float32Array(rest.length);
    for (let i = 0; i < rest.length; i += 3) {
      const x = rest[i], y = rest[i + 1], z = rest[i + 2];
      out[i] = r[0] * x + r[1] * y + r[2] * z + tip[0];
      out[i + 1] = r[3] * x + r[4] * y + r[5] * z + tip[1];
      out[i + 2] = r[6] * x + r[7] * y + r[8] * z + tip[2];
    }
    return out;
  }

  #recolour() {
    if (this.colour === "none" || !this.answer) return;
    const { values } = this, { displacement: u, errors } = this.answer;
    if (this.colour === "displacement") {
      for (let i = 0, k = 0; i < values.length; i++, k += 3) values[i] = Math.hypot(u[k], u[k + 1], u[k + 2]);
    } else {
      const chosen = this.colour === "error" ? errors : this.difference;
      if (chosen) values.set(chosen);
      else values.fill(0);
    }
    this.skinMesh.setValues(values);
    let most = 0;
    for (const value of values) if (value > most) most = value;
    // The legend's end stays while it fits, so that colours do not flicker as the probe moves.
    const end = niceEnd(Math.max(most, 1e-4));
    if (end > this.range || most < 0.3 * this.range) this.range = end;
  }

  /** The tissue in the plane, one item a colour; nothing where the answer does not tell of it. */
  #inside() {
    const plane = this.cut.plane(this.camera.eye), inner = this.answer?.inner, { section } = this;
    if (!plane || !inner || !section) return [];
    section.cut(inner.displacement, plane);
    const { displacement: u } = inner, n = section.beyond.length;
    const values = {
      displacement: () => Float32Array.from({ length: n }, (_, i) => Math.hypot(u[3 * i], u[3 * i + 1], u[3 * i + 2])),
      error: () => inner.errors, difference: () => this.innerDifference,
    }[this.colour]?.();
    if (values) section.spread(values);
    this.cloth.refresh();
    const shared = { mesh: this.cloth, both: true, range: values ? this.range : 0 };
    return section.runs.map((run) => ({ ...shared, runs: [run], colour: TISSUES[run.kind % TISSUES.length] }));
  }

  #fit() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    this.camera.aspect = clientWidth / clientHeight;
    this.ask();
  }

  #paint(scale) {
    const { clientWidth, clientHeight } = this.canvas;
    this.renderer.resize(Math.max(1, Math.round(clientWidth * scale)), Math.max(1, Math.round(clientHeight * scale)));
    const items = this.parts.map(({ mesh, colour }, k) => ({ mesh, colour, model: this.answer?.parts[k].placement }));
    for (const { index, rotation, tip } of this.answer?.probes ?? []) {
      items.push({ mesh: this.probeMesh, colour: PROBES[index % 2], model: placement(rotation, tip) });
    }
    items.push(...this.#inside());
    if (this.opacity > 0) {
      items.push({
        mesh: this.skinMesh, colour: SKIN, inside: INSIDE, opacity: this.opacity,
        range: this.colour === "none" ? 0 : this.range, cut: this.cut.plane(this.camera.eye),
      });
    }
    this.renderer.draw(this.camera, items, this.ground);
    this.dispatchEvent(new Event("drawn"));
  }
}
