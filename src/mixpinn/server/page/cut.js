// The cutting plane: which way it faces and where it stands.

const AXES = { sagittal: 0, coronal: 1, axial: 2 };

export class Cut {
  constructor({ low, high }) {
    this.low = low;
    this.high = high;
    this.kind = "none";
    this.share = 0.5; // of the body's extent
  }

  /** Where it stands along its axis [mm]. */
  get at() {
    const axis = AXES[this.kind];
    return axis === undefined ? 0 : this.low[axis] + this.share * (this.high[axis] - this.low[axis]);
  }

  /** (n, d) with n · x + d > 0 for what is taken away; undefined without a cut. The side of the eye is taken away. */
  plane(eye) {
    const axis = AXES[this.kind];
    if (axis === undefined) return undefined;
    const plane = [0, 0, 0, 0], side = eye[axis] >= this.at ? 1 : -1;
    plane[axis] = side;
    plane[3] = -side * this.at;
    return plane;
  }
}
