// Force, trust and motions as numbers, in the digits that the command line prints too.

import { write } from "./calm.js";
import { length } from "./linear.js";

const at = (id) => document.getElementById(id);

export class Results {
  /**
   * @param {import("./scene.js").Scene} scene
   * @param {import("./probes.js").Probes} probes
   * @param {import("./calm.js").Calm} calm
   */
  constructor(scene, probes, calm) {
    this.probes = probes;
    this.calm = calm;
    this.end = 10; // of the gauge [N]
    this.shown = null; // whose numbers stand there, and of which probe
    this.active = 0;
    this.total = scene.total;
    at("total").hidden = !this.total;
    this.rows = scene.parts.map(({ name, label, colour }) => {
      const row = at("motions").insertRow(), dot = document.createElement("i");
      dot.style.background = colour;
      row.insertCell().append(dot, label);
      row.title = name;
      return { distance: row.insertCell(), angle: row.insertCell() };
    });
  }

  /** Show an answer when the last one has been readable for a moment. */
  show(answer) {
    if (answer !== this.shown || this.active !== this.probes.active) this.calm.ask(this, () => this.#write(answer));
  }

  #write(answer) {
    this.shown = answer;
    this.active = this.probes.active;
    const own = answer.probes.find((one) => one.index === this.probes.active);
    const other = answer.probes.find((one) => one.index !== this.probes.active);
    const force = own ? length(own.force) : 0;
    write(at("force"), force.toFixed(2));
    write(at("force-vector"), own ? own.force.map((value) => signed(value)).join("  ") : "–");
    at("force-other").hidden = !other;
    if (other) write(at("force-second"), `${length(other.force).toFixed(2)} N`);
    while (force > this.end) this.end *= 2;
    at("gauge").style.transform = `scaleX(${(force / this.end).toFixed(3)})`;
    write(at("gauge-end"), `${this.end} N`);
    write(at("tip"), own ? `${own.tip.map((value) => signed(value, 1)).join("  ")} mm` : "–");
    this.rows.forEach(({ distance, angle }, k) => {
      write(distance, answer.parts[k].distance.toFixed(2));
      write(angle, answer.parts[k].angle.toFixed(2));
    });
    this.#trust(answer.trust, own);
    if (this.total) write(at("total"), this.#against(force, Math.max(0, ...answer.parts.map((part) => part.distance))));
    // For whoever drives the page by a script: which answer these numbers are.
    at("force").dataset.sequence = answer.sequence;
  }

  /** The sentence of `TotalError.describe`. */
  #against(force, motion) {
    const by = (share, value, unit) => `${Number((share * value).toPrecision(2))} ${unit} (${Math.round(100 * share)} %)`;
    return `Against the converged solution the force may be off by about ${by(this.total.force, force, "N")}, `
      + `the motions by ${by(this.total.motion, motion, "mm")}.`;
  }

  #trust(trust, own) {
    const known = (value, digits, unit) => (value === null ? "not known" : `${value.toFixed(digits)} ${unit}`);
    write(at("expected"), known(trust.expected, 3, "mm"));
    write(at("bound"), known(trust.bound, 3, "mm"));
    write(at("bound-label"), trust.level ? `${Math.round(100 * trust.level)} % bound` : "Bound");
    write(at("force-bound"), known(trust.forceBound, 2, "N"));
    // The server's notes carry their verdict in front; the page gives its own.
    const why = trust.notes.map((note) => note.replace(/^the answer [^:]*: /, "")).join("; ");
    if (!trust.converged) {
      at("trust-box").dataset.trust = "unsolved";
      write(at("verdict"), `No equilibrium was found. Do not use these numbers${why ? `: ${why}` : ""}.`);
    } else if (trust.outside) {
      at("trust-box").dataset.trust = "outside";
      write(at("verdict"), `Outside of what the model has learned: ${why}. The bounds may not hold.`);
    } else {
      at("trust-box").dataset.trust = "sound";
      const touches = own && length(own.force) > 0;
      const within = touches ? "Within what the model has learned." : "";
      write(at("verdict"), [within, why && capital(`${why}.`)].join(" ").trim());
    }
  }
}

const signed = (value, digits = 2) => (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits);
const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
