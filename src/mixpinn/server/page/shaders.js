// GLSL of everything that is drawn: lit surfaces, coloured by a value or in one colour, perhaps cut by a plane.
//
// Light, half-way vector and direction to the eye are the same all over the picture: the view is narrow, and machines
// without a graphics card spend most of their time in the fragment shader.

const VERTEX = `
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float value;
uniform mat4 camera;
uniform mat4 model;
#ifdef CUT
uniform vec4 cut;         // what lies on its positive side is left out
out float beyond;
#endif
#ifdef PAINT
uniform float range;      // value at the upper end of the colours; 0: one colour
out vec3 facing;
out float share;
#endif
invariant gl_Position; // the pass that lays depth down and the one that paints must agree to the last bit
void main() {
  vec4 world = model * vec4(position, 1.0);
  gl_Position = camera * world;
#ifdef CUT
  beyond = dot(cut, world);
#endif
#ifdef PAINT
  facing = mat3(model) * normal;
  share = range > 0.0 ? value / range : 0.0;
#endif
}`;

const FRAGMENT = `
#ifdef CUT
in float beyond;
#endif
#ifdef PAINT
in vec3 facing;
in float share;
uniform vec3 colour;
uniform vec3 inside;      // of what is seen from behind, through the cut
uniform float opacity;
uniform float range;
uniform vec3 light;
uniform vec3 halfway;     // between light and eye
uniform vec3 eye;         // direction to it
uniform sampler2D colours;
out vec4 painted;
#endif
void main() {
#ifdef CUT
  if (beyond > 0.0) discard;
#endif
#ifdef PAINT
#ifdef CUT
  if (!gl_FrontFacing) {
    painted = vec4(inside, 1.0);
    return;
  }
#endif
  vec3 n = normalize(facing);
  vec3 base = range > 0.0 ? texture(colours, vec2(share, 0.5)).rgb : colour;
  float sheen = max(dot(n, halfway), 0.0);
  sheen *= sheen;
  sheen *= sheen;
  sheen *= sheen;
  sheen *= sheen;
  float lit = 0.37 + 0.62 * max(dot(n, light), 0.0) + 0.07 * dot(n, vec3(-0.3, 0.5, 0.8));
  // Glass is clearest where it is looked at straight; where there is something to tell, the colour counts more.
  float rim = 1.0 - max(dot(n, eye), 0.0);
  float covered = mix(opacity, 1.0, max(0.55 * rim * rim, 0.6 * min(share, 1.0)));
  painted = vec4(base * lit + 0.05 * sheen, opacity < 1.0 ? covered : 1.0);
#endif
}`;

/**
 * Both shaders of a variant.
 *
 * @param {{paint: boolean, cut: boolean}} variant whether it paints or only lays depth down, and whether there is a cut
 */
export function shaders({ paint, cut }) {
  const head = `#version 300 es
precision highp float;
${paint ? "#define PAINT" : ""}
${cut ? "#define CUT" : ""}
`;
  return { vertex: head + VERTEX, fragment: head + FRAGMENT };
}
