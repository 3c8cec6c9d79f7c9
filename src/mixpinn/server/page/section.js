// The tissue where the plane cuts it: every tetrahedron that it crosses gives a triangle or a quadrilateral.

/** The edges of a tetrahedron, by its corners. */
const EDGES = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

// By which corners lie beyond the plane, one bit each: the edges that it crosses, in their order round the cut.
const ROUND = Array.from({ length: 16 }, (_, beyond) => {
  const crossed = EDGES.map(([a, b], e) => [e, (beyond >> a) & 1, (beyond >> b) & 1]).filter(([, a, b]) => a !== b);
  const edges = crossed.map(([e]) => e);
  if (edges.length < 4) return edges;
  // Neighbours in a quadrilateral share a corner of the tetrahedron.
  const touches = (e, f) => EDGES[e].some((corner) => EDGES[f].includes(corner));
  const [first, ...others] = edges, opposite = others.find((e) => !touches(first, e));
  const [second, last] = others.filter((e) => e !== opposite);
  return [first, second, opposite, last];
});

export class Section {
  /** @param {import("./scene.js").Tissue} tissue */
  constructor({ points, cells, kinds }) {
    this.rest = points;
    // One tissue after another, so that each can be drawn in a colour of its own.
    const order = Uint32Array.from(kinds, (_, cell) => cell).sort((a, b) => kinds[a] - kinds[b]);
    this.cells = new Uint32Array(cells.length);
    order.forEach((cell, k) => this.cells.set(cells.subarray(4 * cell, 4 * cell + 4), 4 * k));
    this.kinds = Uint8Array.from(order, (cell) => kinds[cell]);
    this.beyond = new Float32Array(points.length / 3); // of each node, how far it lies beyond the plane [mm]
    this.runs = []; // {kind, first, count} of the vertices of each tissue
    this.#room(4096);
  }

  /** Vertices in use. */
  get count() {
    return this.runs.reduce((sum, { count }) => sum + count, 0);
  }

  /**
   * Cut the body as it stands.
   *
   * @param {Float32Array} displacement of all nodes [mm], three numbers each
   * @param {number[]} plane (n, d): n · x + d = 0, n of length 1
   */
  cut(displacement, [nx, ny, nz, d]) {
    const { rest, cells, kinds, beyond } = this;
    for (let i = 0, k = 0; i < beyond.length; i++, k += 3) {
      beyond[i] = nx * (rest[k] + displacement[k]) + ny * (rest[k + 1] + displacement[k + 1])
        + nz * (rest[k + 2] + displacement[k + 2]) + d;
    }
    this.runs = [];
    let at = 0, run = null;
    for (let c = 0; c < kinds.length; c++) {
      const k = 4 * c;
      const which = (beyond[cells[k]] > 0) | ((beyond[cells[k + 1]] > 0) << 1) | ((beyond[cells[k + 2]] > 0) << 2)
        | ((beyond[cells[k + 3]] > 0) << 3);
      const edges = ROUND[which];
      if (!edges.length) continue;
      if (run?.kind !== kinds[c]) this.runs.push(run = { kind: kinds[c], first: at, count: 0 });
      for (let t = 2; t < edges.length; t++) {
        if (at + 3 > this.share.length) this.#room(2 * this.share.length);
        for (const e of [edges[0], edges[t - 1], edges[t]]) {
          const a = cells[k + EDGES[e][0]], b = cells[k + EDGES[e][1]];
          const share = beyond[a] / (beyond[a] - beyond[b]);
          this.from[at] = a;
          this.to[at] = b;
          this.share[at] = share;
          for (let r = 0; r < 3; r++) {
            const pa = rest[3 * a + r] + displacement[3 * a + r], pb = rest[3 * b + r] + displacement[3 * b + r];
            this.positions[3 * at + r] = pa + share * (pb - pa);
          }
          this.normals[3 * at] = nx;
          this.normals[3 * at + 1] = ny;
          this.normals[3 * at + 2] = nz;
          at += 1;
        }
        run.count += 3;
      }
    }
  }

  /** Values of the vertices in use from those of all nodes, along the edges that they lie on. */
  spread(values) {
    for (let i = 0, { count } = this; i < count; i++) {
      const a = values[this.from[i]];
      this.values[i] = a + this.share[i] * (values[this.to[i]] - a);
    }
  }

  #room(count) {
    const more = (old, array) => (old ? (array.set(old), array) : array);
    this.from = more(this.from, new Uint32Array(count));
    this.to = more(this.to, new Uint32Array(count));
    this.share = more(this.share, new Float32Array(count));
    this.values = more(this.values, new Float32Array(count));
    this.positions = more(this.positions, new Float32Array(3 * count));
    this.normals = more(this.normals, new Float32Array(3 * count));
  }
}
