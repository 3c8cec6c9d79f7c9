// An orbiting camera. The world is the patient's: x to the right, y to the back, z to the feet.

import { add, along, cross, dot, lookAt, multiply, normalize, perspective, scale, subtract } from "./linear.js";

const FOV = 0.5;
const UP = [0, 0, -1]; // towards the head
const STEEPEST = 1.45; // close to the pole, where up would flip

export class Camera {
  /** @param {{low: number[], high: number[]}} bounds of the body [mm] */
  constructor(bounds) {
    this.bounds = bounds;
    this.aspect = 1;
    this.home();
  }

  /** Behind the patient, a little to the right and from above, so that the back's shape shows. */
  home() {
    const { low, high } = this.bounds;
    this.azimuth = 0.2;
    this.elevation = 0.3;
    // The back is what is looked at, not the middle of the trunk.
    this.target = [(low[0] + high[0]) / 2, low[1] + 0.6 * (high[1] - low[1]), (low[2] + high[2]) / 2];
    const tall = (high[2] - low[2]) / 2, wide = (high[0] - low[0]) / 2, deep = (high[1] - low[1]) / 2;
    const half = Math.max(tall + 0.3 * deep, (wide + 0.25 * deep) / Math.min(this.aspect, 1.6));
    this.distance = 0.94 * half / Math.tan(FOV / 2) + 0.5 * deep;
  }

  /** From the patient's right, as far away as before. */
  side() {
    this.azimuth = Math.PI / 2;
    this.elevation = 0.12;
  }

  get back() {
    const c = Math.cos(this.elevation);
    return [Math.sin(this.azimuth) * c, Math.cos(this.azimuth) * c, -Math.sin(this.elevation)];
  }
  get eye() { return along(this.target, this.back, this.distance); }
  get right() { return normalize(cross(UP, this.back)); }
  get top() { return cross(this.back, this.right); }

  get matrix() {
    const near = Math.max(this.distance / 50, 1);
    return multiply(perspective(FOV, this.aspect, near, this.distance + 3000), lookAt(this.eye, this.target, UP));
  }

  /** Turn about the target [rad]. */
  orbit(sideways, upwards) {
    this.azimuth -= sideways;
    this.elevation = Math.min(STEEPEST, Math.max(-STEEPEST, this.elevation + upwards));
  }

  /** Move in the picture's plane; one unit is the picture's height. */
  pan(right, up) {
    const size = 2 * this.distance * Math.tan(FOV / 2);
    this.target = add(this.target, add(scale(this.right, -right * size), scale(this.top, -up * size)));
  }

  zoom(factor) {
    this.distance = Math.min(4000, Math.max(60, this.distance * factor));
  }

  /** The ray through a place of the picture, both coordinates from −1 to 1, up positive. */
  ray(x, y) {
    const h = Math.tan(FOV / 2);
    const direction = add(add(scale(this.back, -1), scale(this.right, x * h * this.aspect)), scale(this.top, y * h));
    return { origin: this.eye, direction: normalize(direction) };
  }

  /** Where a point is seen, from −1 to 1; `ahead` is false behind the eye. */
  project(point) {
    const away = subtract(point, this.eye), h = Math.tan(FOV / 2), depth = -dot(away, this.back);
    return {
      x: dot(away, this.right) / (depth * h * this.aspect), y: dot(away, this.top) / (depth * h), ahead: depth > 0,
    };
  }
}
