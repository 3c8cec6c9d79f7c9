// When to draw, and how finely: pictures are drawn when something changed, coarser where the machine cannot keep up.

const SLOW = 62, FAST = 28; // milliseconds between pictures
const COARSEST = 0.5;
const REST = 250; // milliseconds without a change after which the picture is drawn at its finest

export class Pace {
  /** @param {(scale: number) => void} draw paints one picture with so many device pixels to a CSS pixel */
  constructor(draw) {
    this.draw = draw;
    this.fine = Math.min(window.devicePixelRatio || 1, 2);
    this.scale = this.fine;
    this.times = []; // of the last pictures
    this.interval = FAST;
    this.pending = false;
    this.timer = 0;
  }

  /** Something changed: draw with the next frame of the browser. */
  ask() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => {
      this.pending = false;
      this.#measure(now);
      this.draw(this.scale);
      clearTimeout(this.timer);
      // A still picture is seen for long: half as many pixels again each way smooth its edges.
      this.timer = setTimeout(() => requestAnimationFrame(() => this.pending || this.draw(this.still)), REST);
    });
  }

  /** Pixels of a still picture; a machine that is slow at drawing gets fewer. */
  get still() {
    return this.interval > SLOW ? this.fine : Math.min(1.5 * this.fine, 2.5);
  }

  /** Pictures of the last second. */
  get rate() {
    const now = performance.now();
    return this.times.filter((time) => now - time < 1000).length;
  }

  #measure(now) {
    const last = this.times.at(-1);
    this.times.push(now);
    if (this.times.length > 150) this.times.shift();
    if (last === undefined || now - last > 300) return; // a pause, not slowness
    this.interval += 0.15 * (now - last - this.interval);
    if (this.interval > SLOW && this.scale > COARSEST) {
      this.scale = Math.max(COARSEST, 0.8 * this.scale);
      this.interval = (SLOW + FAST) / 2;
    } else if (this.interval < FAST && this.scale < this.fine) {
      this.scale = Math.min(this.fine, 1.1 * this.scale);
      this.interval = (SLOW + FAST) / 2;
    }
  }
}
