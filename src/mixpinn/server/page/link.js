// The connection to the server: poses out, answers in. It comes back by itself when the server does.

import { readFrame } from "./frame.js";
import { address } from "./scene.js";

const AGAIN = [500, 1000, 2000, 4000]; // milliseconds between attempts

const PATIENCE = 1000; // milliseconds until a pose goes out although the last one has not been shown

/**
 * Poses go out one after another: the next one, the newest that is wanted by then, when the picture of the one before
 * has been drawn. More of them would only take the processor's time from drawing.
 *
 * Dispatches `open`, `closed` (detail: why, in words), `answer` (detail: an Answer) and the type of each control
 * message of the server (detail: the message).
 */
export class Link extends EventTarget {
  /** @param {Uint32Array} skin node of each vertex of the skin */
  constructor(skin) {
    super();
    this.skin = skin;
    this.vertices = "skin";
    this.socket = null;
    this.attempts = 0;
    this.friction = "remembered";
    this.nextId = 1;
    this.asked = 0; // when the first pose went out that has not been answered or refused; 0: none
    this.waiting = new Map(); // of each probe the newest pose that has not gone out
    this.flying = 0; // number of the newest pose that went out and was not shown or refused yet; 0: none
    this.due = false; // poses go out at the end of this task
    this.timer = 0;
  }

  connect() {
    const url = address("live");
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url, "mixpinn.live.1");
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => this.send({
      type: "hello", version: 1, vertices: this.vertices, encoding: "int16", errors: true, friction: this.friction,
    }));
    socket.addEventListener("message", ({ data }) => {
      this.asked = 0;
      if (typeof data !== "string") {
        this.#tell("answer", readFrame(data, this.skin));
        return;
      }
      const message = JSON.parse(data);
      if (message.type === "welcome") {
        this.attempts = 0;
        this.#tell("open", message);
      } else {
        if (message.type === "error" && message.id === this.flying) this.#landed();
        this.#tell(message.type, message);
      }
    });
    socket.addEventListener("close", ({ code, reason }) => {
      this.waiting.clear();
      this.asked = this.flying = 0;
      clearTimeout(this.timer);
      this.#tell("closed", { code, reason });
      setTimeout(() => this.connect(), AGAIN[Math.min(this.attempts++, AGAIN.length - 1)]);
    });
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Milliseconds since a pose went out that nothing has come back for. */
  get owed() {
    return this.asked ? performance.now() - this.asked : 0;
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }

  /**
   * Move a probe. What is wanted until the next pose can go out goes out once, as it was last.
   *
   * @param {number} probe
   * @param {import("./probes.js").Wish} wish
   */
  press(probe, wish) {
    this.waiting.set(probe, wish);
    this.#next();
  }

  /** The picture of the answer to pose `id` has been drawn. */
  shown(id) {
    if (this.flying && id >= this.flying) this.#landed();
  }

  /** Whether friction remembers the way: `remembered` or `straight`. */
  chooseFriction(friction) {
    this.friction = friction;
    this.send({ type: "set", friction });
  }

  /** Of what answers tell: `skin` or all `nodes` of the body. */
  chooseVertices(vertices) {
    if (vertices === this.vertices) return;
    this.vertices = vertices;
    this.send({ type: "set", vertices });
  }

  #landed() {
    clearTimeout(this.timer);
    this.flying = 0;
    this.#next();
  }

  #next() {
    if (this.due || this.flying || !this.waiting.size) return;
    this.due = true;
    queueMicrotask(() => this.#flush()); // all probes that this task moves go out together
  }

  #flush() {
    this.due = false;
    if (!this.waiting.size) return;
    this.asked ||= performance.now();
    for (const [probe, { point, depth, turn, tiltRight, tiltDown }] of this.waiting) {
      this.send({
        type: "skin", id: this.nextId++, probe, point, depth, axis: "pressing", turn_deg: turn,
        // About x the shaft leans to the feet, about z to the left.
        tilt_deg: [tiltDown, -tiltRight],
      });
    }
    this.waiting.clear();
    if (!this.isOpen) return;
    this.flying = this.nextId - 1;
    this.timer = setTimeout(() => this.#landed(), PATIENCE);
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}
