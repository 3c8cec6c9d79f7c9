// When to draw, and how finely: pictures are drawn when something changed, coarser where the machine cannot keep up.

const SLOW = 62, FAST = 28; // milliseconds until the browser takes the next picture
const COARSEST = 0.5;
const AGAIN = 2000; // milliseconds until a coarser picture becomes finer again: each change costs a new drawing buffer
const REST = 400; // milliseconds without a change after which the picture is drawn at its finest

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
    this.changed = 0; // when the scale did, last
  }

  /** Something changed: draw with the next frame of the browser. */
  ask() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => {
      this.pending = false;
      this.times.push(now);
      if (this.times.length > 150) this.times.shift();
      this.draw(this.scale);
      // The next frame comes when this one is done: what lies between tells the cost, however seldom answers come.
      requestAnimationFrame((next) => this.#measure(next - now));
      clearTimeout(this.timer);
      // A still picture is seen for long: half as many pixels again each way smooth its edges.
      this.timer = setTimeout(() => requestAnimationFrame(() => this.pending || this.draw(this.still)), REST);
    });
  }

  /** Fineness of a still picture; a machine that is slow at drawing is spared. */
  get still() {
    return this.scale < this.fine ? this.fine : Math.min(1.5 * this.fine, 2.5);
  }

  /** Pictures of the last second. */
  get rate() {
    const now = performance.now();
    return this.times.filter((time) => now - time < 1000).length;
  }

  #measure(cost) {
    this.interval += 0.25 * (Math.min(cost, 500) - this.interval);
    if (this.interval > SLOW && this.scale > COARSEST) {
      this.#become(Math.max(COARSEST, 0.75 * this.scale));
    } else if (this.interval < FAST && this.scale < this.fine && performance.now() - this.changed > AGAIN) {
      this.#become(Math.min(this.fine, 1.25 * this.scale));
    }
  }

  #become(scale) {
    this.scale = scale;
    this.interval = (SLOW + FAST) / 2;
    this.changed = performance.now();
  }
}
