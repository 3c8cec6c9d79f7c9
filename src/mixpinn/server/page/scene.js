// What does not move, read once over HTTP: skin, rigid parts, probe, and what the bundle says of itself.

/**
 * @typedef {object} Scene
 * @property {string} name
 * @property {{low: number[], high: number[]}} bounds of the skin [mm]
 * @property {Geometry & {nodes: Uint32Array}} skin with the node of the body that each vertex is
 * @property {(Geometry & {name: string, label: string, colour: string})[]} parts
 * @property {Geometry} probe in its own frame, tip at the origin, pointing to −y
 * @property {number[]} direction along which the bundle learned to press, of length 1
 * @property {number} deepest depth that it learned from [mm]
 * @property {() => Promise<Tissue>} tissue reads what lies inside, when it is to be seen
 * @property {{force: number, motion: number} | null} total error against the converged solution, relative
 *
 * @typedef {{points: Float32Array, triangles: Uint32Array}} Geometry
 *
 * @typedef {object} Tissue what the skin holds, without what is rigid
 * @property {Float32Array} points of all nodes of the body at rest [mm]
 * @property {Uint32Array} cells tetrahedra, four node ids each
 * @property {Uint8Array} kinds of each tetrahedron its tissue
 */

/**
 * @returns {Promise<Scene>}
 * @throws {Error} where the server does not answer or sends something else
 */
export async function loadScene() {
  const about = JSON.parse(new TextDecoder().decode(await get("api/scene.json")));
  if (about.version !== 1) throw new Error(`The server speaks version ${about.version} of the protocol, this page 1.`);
  const [skin, probe, ...parts] = await Promise.all([
    surface(about.skin.url), surface(about.probes[0].url), ...about.parts.map(({ url }) => surface(url)),
  ]);
  const { direction, deepest } = about.range;
  return {
    name: about.name, discretisation: about.discretisation, warnings: about.warnings ?? [], direction, deepest,
    total: about.total_error ?? null,
    bounds: { low: about.low, high: about.high }, skin, probe,
    tissue: () => loadTissue(about.tissue.url),
    parts: parts.map((part, k) => ({ ...part, ...about.parts[k] })),
  };
}

/** A path of the server; the token of this page's own address goes along where there is one. */
export function address(path) {
  const url = new URL(path, location.href), token = new URLSearchParams(location.search).get("token");
  if (token) url.searchParams.set("token", token);
  return url;
}

async function get(path) {
  const answer = await fetch(address(path));
  if (!answer.ok) throw new Error(`The server refuses ${path}: ${answer.status} ${answer.statusText}.`);
  return answer.arrayBuffer();
}

async function surface(path) {
  const data = await get(path), head = new DataView(data);
  if (head.getUint32(0, false) !== 0x4d585346) throw new Error(`${path} is no surface of this protocol.`); // "MXSF"
  const v = head.getUint32(4, true), t = head.getUint32(8, true);
  return {
    points: new Float32Array(data, 12, 3 * v), triangles: new Uint32Array(data, 12 + 12 * v, 3 * t),
    nodes: new Uint32Array(data, 12 + 12 * v + 12 * t, v),
  };
}

async function loadTissue(path) {
  const data = await get(path), head = new DataView(data);
  if (head.getUint32(0, false) !== 0x4d585453) throw new Error(`${path} is no tissue of this protocol.`); // "MXTS"
  const n = head.getUint32(4, true), t = head.getUint32(8, true);
  return {
    points: new Float32Array(data, 12, 3 * n), cells: new Uint32Array(data, 12 + 12 * n, 4 * t),
    kinds: new Uint8Array(data, 12 + 12 * n + 16 * t, t),
  };
}
