// Frames of answers, as docs/reference/live-protocol.md lays them out.

const HEAD = 96, PROBE = 112, PART = 72;
export const LIVE = 1, REPLAY = 2, FULL = 3;
const ALL_NODES = 1;

/**
 * @typedef {object} Answer
 * @property {number} kind LIVE, REPLAY or FULL
 * @property {number} poseId of the newest pose in it
 * @property {number} sequence
 * @property {Trust} trust
 * @property {{index: number, poseId: number, depth: number, rotation: number[], tip: number[], force: number[]}[]} probes
 *   rotations row by row, tips [mm], forces of the tissue on each [N]
 * @property {{placement: Float32Array, distance: number, angle: number}[]} parts 4 × 4 by columns, [mm], [degree]
 * @property {Float32Array} displacement of the skin [mm], three numbers a vertex
 * @property {Float32Array | null} errors expected error of each of its vertices [mm]
 * @property {{displacement: Float32Array, errors: Float32Array | null} | null} inner the same of all nodes of the body
 *
 * @typedef {object} Trust
 * @property {number | null} expected [mm]
 * @property {number | null} bound [mm]
 * @property {number | null} level
 * @property {number | null} forceBound [N]
 * @property {number | null} motionBound [mm]
 * @property {boolean} outside
 * @property {boolean} converged
 * @property {string[]} notes what speaks against it, or what else there is to know
 */

/**
 * @param {ArrayBuffer} data
 * @param {Uint32Array} skin node of each vertex of the skin
 * @returns {Answer}
 */
export function readFrame(data, skin) {
  const view = new DataView(data);
  if (view.byteLength < HEAD || view.getUint32(0, false) !== 0x4d584c56 || view.getUint8(4) !== 1) { // "MXLV"
    throw new Error("The server sent something that is no answer of this protocol.");
  }
  const uint = (at) => view.getUint32(at, true), float = (at) => view.getFloat32(at, true);
  const floats = (at, count) => Array.from({ length: count }, (_, i) => float(at + 4 * i));
  const known = (at) => (Number.isNaN(float(at)) ? null : float(at));
  const encoding = view.getUint8(6), flags = uint(16);
  const nProbes = uint(20), nParts = uint(24), n = uint(28), notesBytes = uint(32);
  let at = HEAD;

  const probes = Array.from({ length: nProbes }, (_, i) => {
    const start = at + PROBE * i, m = floats(start + 16, 16);
    return {
      index: uint(start), poseId: uint(start + 4), depth: float(start + 8),
      rotation: [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]], tip: [m[3], m[7], m[11]],
      force: floats(start + 80, 3),
    };
  });
  at += PROBE * nProbes;

  const parts = Array.from({ length: nParts }, (_, i) => {
    const start = at + PART * i, m = floats(start, 16), byColumns = new Float32Array(16);
    for (let r = 0; r < 4; r++) for (let c = 0; c < 4; c++) byColumns[4 * c + r] = m[4 * r + c];
    return { placement: byColumns, distance: float(start + 64), angle: float(start + 68) };
  });
  at += PART * nParts;

  const notes = JSON.parse(new TextDecoder().decode(new Uint8Array(data, at, notesBytes)));
  at += notesBytes;

  let displacement = new Float32Array(3 * n);
  if (encoding === 1) {
    const packed = new Int16Array(data, at, 3 * n), unit = float(36);
    for (let i = 0; i < packed.length; i++) displacement[i] = packed[i] * unit;
    at += 4 * Math.ceil((6 * n) / 4);
  } else if (encoding === 2) {
    displacement = new Float32Array(data, at, 3 * n);
    at += 12 * n;
  }
  const unit = float(88);
  let errors = flags & 16 ? Float32Array.from(new Uint16Array(data, at, n), (value) => value * unit) : null, inner = null;
  if (view.getUint8(7) === ALL_NODES) {
    inner = { displacement, errors };
    displacement = new Float32Array(3 * skin.length);
    for (let i = 0; i < skin.length; i++) {
      for (let r = 0; r < 3; r++) displacement[3 * i + r] = inner.displacement[3 * skin[i] + r];
    }
    errors &&= Float32Array.from(skin, (node) => inner.errors[node]);
  }

  return {
    kind: view.getUint8(5), poseId: uint(8), sequence: uint(12), time: view.getFloat64(40, true), solveMs: float(48),
    trust: {
      expected: known(56), bound: known(60), level: known(64), forceBound: known(72), motionBound: known(80),
      outside: Boolean(flags & 2), converged: Boolean(flags & 1), notes,
    },
    probes, parts, displacement, errors, inner,
  };
}
