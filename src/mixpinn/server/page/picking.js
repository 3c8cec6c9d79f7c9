// Where a ray meets a surface (T. Möller and B. Trumbore, Journal of Graphics Tools 2, 1997).

import { along } from "./linear.js";

/**
 * The nearest hit; every triangle is tried, which takes well under a millisecond for some ten thousand.
 *
 * @param {ArrayLike<number>} points [mm], three numbers each
 * @param {Uint32Array} triangles three point ids each
 * @param {{origin: number[], direction: number[]}} ray
 * @param {{kept?: (point: number[]) => boolean}} [options] what is cut away is not hit
 * @returns {{point: number[], distance: number, triangle: number, front: boolean} | null}
 */
export function meet(points, triangles, { origin, direction }, { kept } = {}) {
  const [ox, oy, oz] = origin, [dx, dy, dz] = direction;
  let best = Infinity, found = -1, front = true;
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const ax = points[a], ay = points[a + 1], az = points[a + 2];
    const ux = points[b] - ax, uy = points[b + 1] - ay, uz = points[b + 2] - az;
    const vx = points[c] - ax, vy = points[c + 1] - ay, vz = points[c + 2] - az;
    const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx;
    const det = ux * px + uy * py + uz * pz;
    if (det > -1e-12 && det < 1e-12) continue;
    const sx = ox - ax, sy = oy - ay, sz = oz - az;
    const u = (sx * px + sy * py + sz * pz) / det;
    if (u < -1e-9 || u > 1 + 1e-9) continue;
    const qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux;
    const v = (dx * qx + dy * qy + dz * qz) / det;
    if (v < -1e-9 || u + v > 1 + 1e-9) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / det;
    if (distance <= 1e-6 || distance >= best) continue;
    if (kept && !kept([ox + distance * dx, oy + distance * dy, oz + distance * dz])) continue;
    best = distance;
    found = t / 3;
    front = det > 0;
  }
  return found < 0 ? null : { point: along(origin, direction, best), distance: best, triangle: found, front };
}
