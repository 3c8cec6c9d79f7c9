// Draws surfaces with WebGL 2. Buffers are made once and overwritten when points move; nothing is rebuilt.

import { along, normalize } from "./linear.js";
import { shaders } from "./shaders.js";

const UNMOVED = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
const UNIFORMS = [
  "camera", "model", "cut", "range", "colour", "inside", "opacity", "light", "halfway", "eye", "colours",
];

/**
 * @typedef {object} Item what to draw
 * @property {Mesh} mesh
 * @property {Float32Array} [model] its placement, 4 × 4
 * @property {number[]} colour red, green, blue from 0 to 1
 * @property {number[]} [inside] colour of its back
 * @property {number} [opacity]
 * @property {number} [range] value at the upper end of the colours; 0 for one colour
 * @property {number[]} [cut] plane (n, d): points with n · x + d > 0 are left out
 * @property {{first: number, count: number}[]} [runs] which of the mesh's vertices; without it all of them
 * @property {boolean} [both] whether it is seen from both sides alike
 */

export class Renderer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @throws {Error} where the browser has no WebGL 2
   */
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("This browser cannot draw in three dimensions (WebGL 2 is missing or switched off).");
    this.gl = gl;
    this.programs = new Map();
    this.palette = gl.createTexture();
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.cullFace(gl.BACK);
  }

  /** @returns {Cloth} the buffers of a section, whose triangles are others after each cut */
  cloth(section) {
    return new Cloth(this.gl, section);
  }

  /** @returns {Mesh} the buffers of a surface */
  mesh(surface) {
    return new Mesh(this.gl, surface);
  }

  /** Colours of values, as red, green, blue bytes from the lowest to the highest. */
  setPalette(bytes) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, bytes.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
      gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    }
  }

  /** Picture size in device pixels. */
  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
  }

  /**
   * @param {{matrix: Float32Array, back: number[]}} camera
   * @param {Item[]} items opaque ones first; a transparent one shows its nearest layer only
   * @param {number[]} background red, green, blue from 0 to 1
   */
  draw(camera, items, background) {
    const { gl } = this;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    // The light stands above the eye, at the patient's right.
    const light = normalize(along(camera.back, [0.25, 0.2, -0.75], 0.8));
    const shared = { camera: camera.matrix, light, eye: camera.back, halfway: normalize(along(light, camera.back, 1)) };
    for (const item of items) this.#paint(item, shared);
    gl.bindVertexArray(null);
  }

  #paint({ mesh, cut, runs, both, ...item }, shared) {
    const { gl } = this, hasCut = Boolean(cut), isClear = item.opacity < 1;
    const values = {
      inside: item.colour, opacity: 1, range: 0, ...shared, ...item, model: item.model ?? UNMOVED, cut,
    };
    gl.bindVertexArray(mesh.array);
    const paint = () => {
      if (!runs) gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
      else for (const { first, count } of runs) gl.drawArrays(gl.TRIANGLES, first, count);
    };
    // Backs are seen through a cut only.
    if (hasCut || both) gl.disable(gl.CULL_FACE);
    else gl.enable(gl.CULL_FACE);
    if (isClear) {
      // Depth first, so that of all layers the nearest one is painted, once, over what is opaque.
      this.#use({ paint: false, cut: hasCut }, values);
      gl.colorMask(false, false, false, false);
      paint();
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.EQUAL);
      gl.enable(gl.BLEND);
    }
    this.#use({ paint: true, cut: hasCut }, values);
    paint();
    gl.disable(gl.BLEND);
    gl.depthFunc(gl.LESS);
  }

  #use(variant, values) {
    const { gl } = this, key = JSON.stringify(variant);
    if (!this.programs.has(key)) {
      const program = link(gl, shaders(variant)), places = new Map();
      for (const name of UNIFORMS) {
        const place = gl.getUniformLocation(program, name);
        if (place) places.set(name, place);
      }
      this.programs.set(key, { program, places });
    }
    const { program, places } = this.programs.get(key);
    gl.useProgram(program);
    for (const [name, place] of places) {
      const value = values[name];
      if (name === "colours") gl.uniform1i(place, 0);
      else if (typeof value === "number") gl.uniform1f(place, value);
      else if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
      else if (value.length === 4) gl.uniform4fv(place, value);
      else gl.uniform3fv(place, value);
    }
  }

  /** The picture as a PNG; it is to be drawn in the same task, since browsers forget it afterwards. */
  picture() {
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }
}

export class Mesh {
  constructor(gl, surface) {
    this.gl = gl;
    this.surface = surface;
    this.count = surface.corners.length;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.values = new Float32Array(surface.source.length);
    this.buffers = [surface.positions, surface.normals, this.values].map((data, place) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, place < 2 ? 3 : 1, gl.FLOAT, false, 0, 0);
      return buffer;
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, surface.corners, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  /** Positions and normals as the surface has them now. */
  refresh() {
    this.#write(0, this.surface.positions);
    this.#write(1, this.surface.normals);
  }

  /** Colour values, one for each point of the surface. */
  setValues(values) {
    const { source } = this.surface;
    for (let i = 0; i < source.length; i++) this.values[i] = values[source[i]];
    this.#write(2, this.values);
  }

  #write(place, data) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.buffers[place]);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, data);
  }
}

/** Loose triangles, three vertices each, as many as there are just now. */
export class Cloth {
  constructor(gl, section) {
    this.gl = gl;
    this.section = section;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.buffers = [3, 3, 1].map((size, place) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
      return buffer;
    });
    gl.bindVertexArray(null);
  }

  /** What the section holds now. */
  refresh() {
    const { gl, section: { positions, normals, values, count } } = this;
    [[positions, 3], [normals, 3], [values, 1]].forEach(([data, size], place) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[place]);
      gl.bufferData(gl.ARRAY_BUFFER, data.subarray(0, size * count), gl.DYNAMIC_DRAW);
    });
  }
}

function link(gl, { vertex, fragment }) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}
