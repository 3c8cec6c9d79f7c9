// A triangulated surface whose points may move: what is drawn, what a ray meets, and the normals of both.

import { cross, dot, normalize, subtract } from "./linear.js";

/**
 * Points are doubled along sharp edges (an angle between faces beyond `crease`), so that each side keeps its own normal.
 * Which corners share one is settled on the surface at rest; afterwards only numbers change, in place.
 */
export class Surface {
  /**
   * @param {Float32Array} points at rest [mm], three numbers each
   * @param {Uint32Array} triangles outward, three point ids each
   * @param {number} crease [degree]
   */
  constructor(points, triangles, crease = 50) {
    this.rest = points;
    this.points = Float32Array.from(points);
    this.triangles = triangles;
    const { source, corners } = splitAtCreases(points, triangles, Math.cos((crease * Math.PI) / 180));
    this.source = source; // of each drawn vertex the point
    this.corners = corners; // of each triangle the drawn vertices
    this.positions = new Float32Array(3 * source.length);
    this.normals = new Float32Array(3 * source.length);
    this.refresh();
  }

  /** Drawn positions and normals from `points`. */
  refresh() {
    const { points, positions, normals, source, triangles, corners } = this;
    for (let i = 0; i < source.length; i++) {
      const at = 3 * source[i];
      positions[3 * i] = points[at];
      positions[3 * i + 1] = points[at + 1];
      positions[3 * i + 2] = points[at + 2];
    }
    normals.fill(0);
    for (let t = 0; t < triangles.length; t += 3) {
      const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
      const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
      const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx; // larger faces count more
      for (let k = 0; k < 3; k++) {
        const n = 3 * corners[t + k];
        normals[n] += x;
        normals[n + 1] += y;
        normals[n + 2] += z;
      }
    }
    for (let n = 0; n < normals.length; n += 3) {
      const size = 1 / Math.max(Math.hypot(normals[n], normals[n + 1], normals[n + 2]), 1e-30);
      normals[n] *= size;
      normals[n + 1] *= size;
      normals[n + 2] *= size;
    }
  }
}

function splitAtCreases(points, triangles, smallest) {
  const faces = triangles.length / 3;
  const normal = new Array(faces);
  const around = Array.from({ length: points.length / 3 }, () => []);
  const point = (i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
  for (let f = 0; f < faces; f++) {
    const [a, b, c] = [0, 1, 2].map((k) => point(triangles[3 * f + k]));
    normal[f] = normalize(cross(subtract(b, a), subtract(c, a)));
    for (let k = 0; k < 3; k++) around[triangles[3 * f + k]].push(3 * f + k);
  }
  const source = [], corners = new Uint32Array(triangles.length);
  around.forEach((own, i) => {
    const groups = []; // each with the mean direction of its faces
    for (const corner of own) {
      const n = normal[Math.floor(corner / 3)];
      let group = groups.find((g) => dot(normalize(g.sum), n) > smallest);
      if (!group) {
        group = { vertex: source.length, sum: [0, 0, 0] };
        source.push(i);
        groups.push(group);
      }
      for (let k = 0; k < 3; k++) group.sum[k] += n[k];
      corners[corner] = group.vertex;
    }
  });
  return { source: Uint32Array.from(source), corners };
}
