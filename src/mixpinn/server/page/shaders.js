// GLSL of everything that is drawn: lit surfaces, coloured by a value or in one colour, cut by a plane.

export const VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float value;
uniform mat4 camera;
uniform mat4 model;
out vec3 place;
out vec3 facing;
out float amount;
invariant gl_Position; // the pass that lays depth down and the one that paints must agree to the last bit
void main() {
  vec4 world = model * vec4(position, 1.0);
  place = world.xyz;
  facing = mat3(model) * normal;
  amount = value;
  gl_Position = camera * world;
}`;

export const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place;
in vec3 facing;
in float amount;
uniform vec3 eye;
uniform vec3 colour;
uniform vec3 inside;      // of what is seen from behind, through the cut
uniform float opacity;
uniform float range;      // value at the upper end of the colours; 0: one colour
uniform vec4 cut;         // what lies on its positive side is left out
uniform sampler2D colours;
out vec4 painted;
void main() {
  float beyond = dot(cut.xyz, place) + cut.w;
  if (beyond > 0.0) discard;
  vec3 toEye = normalize(eye - place);
  if (!gl_FrontFacing) {
    painted = vec4(inside, 1.0);
    return;
  }
  vec3 n = normalize(facing);
  float share = range > 0.0 ? clamp(amount / range, 0.0, 1.0) : 0.0;
  vec3 base = range > 0.0 ? texture(colours, vec2(share, 0.5)).rgb : colour;
  // One light from above the eye, a weak one from below, and a sheen that shows the shape.
  float key = max(dot(n, normalize(toEye + vec3(0.25, 0.2, -0.75))), 0.0);
  float fill = 0.5 + 0.5 * dot(n, vec3(-0.3, 0.5, 0.8));
  float sheen = pow(max(dot(n, normalize(2.0 * toEye + vec3(0.25, 0.2, -0.75))), 0.0), 40.0);
  vec3 lit = base * (0.30 + 0.62 * key + 0.14 * fill) + 0.07 * sheen;
  // Glass is clearest where it is looked at straight; where there is something to tell, the colour counts more.
  float rim = 1.0 - max(dot(n, toEye), 0.0);
  painted = vec4(lit, mix(opacity, 1.0, (1.0 - opacity) * max(0.55 * rim * rim, 0.6 * share)));
}`;
