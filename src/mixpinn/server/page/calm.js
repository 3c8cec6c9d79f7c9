// Changes of numbers and controls wait for each other: the page changes seldom, all at once, and with a picture.

const EVERY = 100; // milliseconds between two changes: faster than reading, and cheap
const ANYWAY = 60; // milliseconds after which a change is made although no picture comes

export class Calm {
  constructor() {
    this.waiting = new Map(); // by whom, the newest change
    this.last = -Infinity;
    this.timer = 0;
  }

  /** Have `change` made soon; an earlier one of the same `owner` that still waits is not made any more. */
  ask(owner, change) {
    this.waiting.set(owner, change);
    if (!this.timer) this.timer = setTimeout(() => this.now(), Math.max(0, this.#left) + ANYWAY);
  }

  /** A picture was drawn: what waits may go along. */
  drawn() {
    if (this.waiting.size && this.#left <= 0) this.now();
  }

  /** Whoever chose something is not to wait. */
  now() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.last = performance.now();
    const changes = [...this.waiting.values()];
    this.waiting.clear();
    for (const change of changes) change();
  }

  get #left() {
    return this.last + EVERY - performance.now();
  }
}

/** Write a text where it is another one than before: each write costs the browser a new layout. */
export function write(element, text) {
  if (element.textContent === text) return;
  // The text node stays, so that nothing but its letters changes.
  if (element.firstChild?.nodeType === Node.TEXT_NODE && element.childNodes.length === 1) element.firstChild.data = text;
  else element.textContent = text;
}
