// The full solution of the present pose, beside the model's answer.

import { FULL } from "./frame.js";

const at = (id) => document.getElementById(id);

export class Comparison {
  /**
   * @param {import("./link.js").Link} link
   * @param {import("./stage.js").Stage} stage
   * @param {import("./probes.js").Probes} probes
   * @param {(name: string) => void} colourBy
   */
  constructor(link, stage, probes, colourBy) {
    this.link = link;
    this.stage = stage;
    this.running = false;
    this.before = "displacement"; // what was coloured by
    this.colourBy = colourBy;
    at("compare").addEventListener("click", () => this.start());
    link.addEventListener("progress", ({ detail }) => {
      if (this.running) at("compared").textContent = `Solving: ${detail.done} of ${detail.of} steps, ${detail.seconds.toFixed(0)} s`;
    });
    link.addEventListener("comparison", ({ detail }) => this.#tell(detail));
    link.addEventListener("error", ({ detail }) => {
      // An error with a number is of a pose: the solution goes on.
      if (this.running && detail.id === null) this.#stop(detail.text);
    });
    link.addEventListener("closed", () => this.#stop(""));
    probes.addEventListener("wish", () => this.#forget());
  }

  start() {
    if (this.running) {
      this.link.send({ type: "cancel" });
      this.#stop("Stopped.");
      return;
    }
    this.running = true;
    at("compare").textContent = "Stop";
    at("compared").textContent = "Solving …";
    this.link.send({ type: "compare" });
  }

  /** Take a frame of the full solution; whether it was one. */
  take(answer) {
    if (answer.kind !== FULL) return false;
    const mine = this.stage.answer;
    if (!mine || answer.poseId !== mine.poseId) return true;
    const inner = answer.inner && mine.inner ? distances(answer.inner.displacement, mine.inner.displacement) : null;
    this.stage.setDifference(distances(answer.displacement, mine.displacement), inner);
    this.before = this.stage.colour;
    this.#offer(true);
    this.colourBy("difference");
    return true;
  }

  #tell({ id, mean, largest, force, seconds, model_ms: modelMs, converged }) {
    const newton = (value) => Math.hypot(...[value].flat(2)).toFixed(2);
    this.#stop([
      `Difference: mean ${mean.toFixed(3)} mm, largest ${largest.toFixed(2)} mm`,
      `Force: ${newton(force.full)} N, model ${newton(force.model)} N`,
      `Time: ${seconds.toFixed(1)} s, model ${modelMs.toFixed(1)} ms`,
      ...(converged ? [] : ["The full solution did not converge."]),
      ...(id === this.stage.answer?.poseId ? [] : ["The probe has moved since: this is of where it was."]),
    ].join("\n"));
  }

  #stop(text) {
    this.running = false;
    at("compare").textContent = "Compare with the full solution";
    at("compared").textContent = text;
  }

  /** Another pose: what was compared says nothing of it. */
  #forget() {
    if (this.stage.difference) {
      this.stage.setDifference(null);
      if (this.stage.colour === "difference") this.colourBy(this.before);
      this.#offer(false);
    }
    if (!this.running) at("compared").textContent = "";
  }

  #offer(possible) {
    at("colour").querySelector("[value=difference]").disabled = !possible;
  }
}

/** Between places, three numbers each. */
function distances(a, b) {
  return Float32Array.from({ length: a.length / 3 }, (_, i) => {
    const k = 3 * i;
    return Math.hypot(a[k] - b[k], a[k + 1] - b[k + 1], a[k + 2] - b[k + 2]);
  });
}
