// Force, trust and motions as numbers, in the digits that the command line prints too.

import { length } from "./linear.js";

const at = (id) => document.getElementById(id);
const EVERY = 100; // milliseconds between two renewals of the numbers: faster than reading, and cheap

export class Results {
  /**
   * @param {import("./scene.js").Scene} scene
   * @param {import("./probes.js").Probes} probes
   */
  constructor(scene, probes) {
    this.probes = probes;
    this.end = 10; // of the gauge [N]
    this.written = 0;
    this.shown = null; // whose numbers stand there, and of which probe
    this.active = 0;
    this.timer = 0;
    this.rows = scene.parts.map(({ name, label, colour }) => {
      const row = at("motions").insertRow(), dot = document.createElement("i");
      dot.style.background = colour;
      row.insertCell().append(dot, label);
      row.title = name;
      return { distance: row.insertCell(), angle: row.insertCell() };
    });
  }

  /** Show an answer, at once or when the last one has been readable for a moment. */
  show(answer) {
    if (answer === this.shown && this.active === this.probes.active) return;
    clearTimeout(this.timer);
    const wait = this.written + EVERY - performance.now();
    if (wait <= 0) this.#write(answer);
    else this.timer = setTimeout(() => this.#write(answer), wait);
  }

  #write(answer) {
    this.written = performance.now();
    this.shown = answer;
    this.active = this.probes.active;
    const own = answer.probes.find((one) => one.index === this.probes.active);
    const other = answer.probes.find((one) => one.index !== this.probes.active);
    const force = own ? length(own.force) : 0;
    at("force").textContent = force.toFixed(2);
    at("force-vector").textContent = own ? own.force.map((value) => signed(value)).join("  ") : "–";
    at("force-other").hidden = !other;
    if (other) at("force-second").textContent = `${length(other.force).toFixed(2)} N`;
    while (force > this.end) this.end *= 2;
    at("gauge").style.transform = `scaleX(${(force / this.end).toFixed(3)})`;
    at("gauge-end").textContent = `${this.end} N`;
    at("tip").textContent = own ? `${own.tip.map((value) => signed(value, 1)).join("  ")} mm` : "–";
    this.rows.forEach(({ distance, angle }, k) => {
      distance.textContent = answer.parts[k].distance.toFixed(2);
      angle.textContent = answer.parts[k].angle.toFixed(2);
    });
    this.#trust(answer.trust, own);
    // For whoever drives the page by a script: which answer these numbers are.
    at("force").dataset.sequence = answer.sequence;
  }

  #trust(trust, own) {
    const known = (value, digits, unit) => (value === null ? "not known" : `${value.toFixed(digits)} ${unit}`);
    at("expected").textContent = known(trust.expected, 3, "mm");
    at("bound").textContent = known(trust.bound, 3, "mm");
    at("bound-label").textContent = trust.level ? `${Math.round(100 * trust.level)} % bound` : "Bound";
    at("force-bound").textContent = known(trust.forceBound, 2, "N");
    // The server's notes carry their verdict in front; the page gives its own.
    const why = trust.notes.map((note) => note.replace(/^the answer [^:]*: /, "")).join("; ");
    if (!trust.converged) {
      at("trust-box").dataset.trust = "unsolved";
      at("verdict").textContent = `No equilibrium was found. Do not use these numbers${why ? `: ${why}` : ""}.`;
    } else if (trust.outside) {
      at("trust-box").dataset.trust = "outside";
      at("verdict").textContent = `Outside of what the model has learned: ${why}. The bounds may not hold.`;
    } else {
      at("trust-box").dataset.trust = "sound";
      const touches = own && length(own.force) > 0;
      at("verdict").textContent = [touches ? "Within what the model has learned." : "", why && capital(`${why}.`)].join(" ").trim();
    }
  }
}

const signed = (value, digits = 2) => (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits);
const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
