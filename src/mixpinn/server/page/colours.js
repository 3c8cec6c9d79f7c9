// Colours of values; those of the rigid parts come with the scene.

const RAMPS = {
  displacement: ["#f0dcc8", "#f2b98d", "#e57f62", "#b8466a", "#5c2a66"],
  error: ["#e8eee2", "#a8d3b4", "#4fa8a2", "#2c6f92", "#223f6e"],
  difference: ["#eceae4", "#f1d372", "#e8923f", "#bf4030", "#6d2130"],
};

export const SKIN = rgb("#d8b59c");

export function rgb(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

/** 256 colours of a ramp as bytes. */
export function palette(name) {
  const stops = RAMPS[name].map(rgb), bytes = new Uint8Array(3 * 256);
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2), share = at - k;
    for (let c = 0; c < 3; c++) {
      bytes[3 * i + c] = Math.round(255 * (stops[k][c] * (1 - share) + stops[k + 1][c] * share));
    }
  }
  return bytes;
}

/** The same ramp for style sheets. */
export const gradient = (name) => `linear-gradient(to right, ${RAMPS[name].join(", ")})`;

/** An end of a legend whose half is easy to read too, at least `value`. */
export function niceEnd(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  for (const step of [1, 1.2, 1.6, 2, 3, 4, 5, 6, 8, 10]) if (step * power >= value * 0.999) return step * power;
  return 10 * power;
}
