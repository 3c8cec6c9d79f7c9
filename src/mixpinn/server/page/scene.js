// What does not move, read once over HTTP: skin, rigid parts, probe, and what the bundle says of itself.

/**
 * @typedef {object} Scene
 * @property {string} name
 * @property {{low: number[], high: number[]}} bounds of the skin [mm]
 * @property {Geometry} skin
 * @property {(Geometry & {name: string, label: string, colour: string})[]} parts
 * @property {Geometry} probe in its own frame, tip at the origin, pointing to −y
 * @property {number[]} direction along which the bundle learned to press, of length 1
 * @property {number} deepest depth that it learned from [mm]
 *
 * @typedef {{points: Float32Array, triangles: Uint32Array}} Geometry
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
    bounds: { low: about.low, high: about.high }, skin, probe,
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
  return { points: new Float32Array(data, 12, 3 * v), triangles: new Uint32Array(data, 12 + 12 * v, 3 * t) };
}
