// WebGL 2: programs from the viewer's shaders, textures and render targets.
import { shaders } from "./shaders.js";

// Replaces "#version 330 core". Some samplers have no default precision in WebGL, and others have a
// low one. There is no index map. Callers define CURVED.
const head = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
precision highp samplerCube;
precision highp sampler2DArray;
precision highp usampler2D;
precision highp sampler2DShadow;
precision highp sampler2DArrayShadow;
#define PLACES 0
#define PLACES_LEVEL 0
`;

// Returns the text of a vertex or fragment shader that consists of these files. constants has lines
// "#define NAME value".
export function shaderText(constants, names) {
  return head + constants + names.map(name => shaders[name]).join("");
}

export class Gpu {
  // gl is a WebGL2RenderingContext. Throws an error if it cannot draw into floating-point textures.
  constructor(gl) {
    this.gl = gl;
    if (!gl.getExtension("EXT_color_buffer_float"))
      throw new Error("This device cannot draw into floating-point textures (EXT_color_buffer_float); use another one.");
    this.filtersFloats = gl.getExtension("OES_texture_float_linear") !== null;
    this.largest = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.largest3D = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    this.mostLayers = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    this.programs = new Map();
    this.empty = gl.createVertexArray();
    this.blank = this.texture(gl.TEXTURE_2D, gl.RGBA8, 1, 1);
    this.blankDepth = this.depthMap(1);
  }

  compile(kind, text, name) {
    const gl = this.gl, shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
      throw new Error(`The shader ${name} does not compile on this device: ${gl.getShaderInfoLog(shader)}`);
    return shader;
  }

  // Returns the program of a vertex shader and all other files, which are joined to one fragment
  // shader.
  program(constants, names) {
    const gl = this.gl, key = constants + names.join(" "), known = this.programs.get(key);
    if (known) return known;
    const id = gl.createProgram();
    const parts = [this.compile(gl.VERTEX_SHADER, shaderText(constants, names.slice(0, 1)), names[0]),
      this.compile(gl.FRAGMENT_SHADER, shaderText(constants, names.slice(1)), names.at(-1))];
    for (const part of parts) {
      gl.attachShader(id, part);
      gl.deleteShader(part);
    }
    gl.linkProgram(id);
    if (!gl.getProgramParameter(id, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(`The shader ${names.at(-1)} does not link on this device: ${gl.getProgramInfoLog(id)}`);
    const program = { id, uniforms: this.uniformsOf(id) };
    this.programs.set(key, program);
    return program;
  }

  // Returns a map from the name of each uniform to an object whose function set() sets the uniform.
  // Each sampler has a separate texture unit, because samplers of two types must not share a unit,
  // even if neither is read.
  uniformsOf(id) {
    const gl = this.gl, uniforms = new Map();
    const targets = {
      [gl.SAMPLER_2D]: gl.TEXTURE_2D,
      [gl.UNSIGNED_INT_SAMPLER_2D]: gl.TEXTURE_2D,
      [gl.SAMPLER_2D_SHADOW]: gl.TEXTURE_2D,
      [gl.SAMPLER_2D_ARRAY]: gl.TEXTURE_2D_ARRAY,
      [gl.SAMPLER_3D]: gl.TEXTURE_3D,
      [gl.SAMPLER_CUBE]: gl.TEXTURE_CUBE_MAP,
    };
    const setters = {
      [gl.FLOAT]: (at, value) => gl.uniform1f(at, value),
      [gl.FLOAT_VEC2]: (at, value) => gl.uniform2fv(at, value),
      [gl.FLOAT_VEC3]: (at, value) => gl.uniform3fv(at, value),
      [gl.FLOAT_VEC4]: (at, value) => gl.uniform4fv(at, value),
      [gl.FLOAT_MAT4]: (at, value) => gl.uniformMatrix4fv(at, false, value),
      [gl.INT]: (at, value) => gl.uniform1i(at, value),
      [gl.BOOL]: (at, value) => gl.uniform1i(at, value ? 1 : 0),
    };
    let units = 0;
    for (let k = 0; k < gl.getProgramParameter(id, gl.ACTIVE_UNIFORMS); k++) {
      const { name, type } = gl.getActiveUniform(id, k);
      const at = gl.getUniformLocation(id, name), target = targets[type];
      if (target === undefined) {
        uniforms.set(name, { set: value => setters[type](at, value) });
        continue;
      }
      const unit = units++;
      const blank = type === gl.SAMPLER_2D_SHADOW ? this.blankDepth
        : type === gl.SAMPLER_2D ? this.blank : null;
      const set = value => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(target, value || blank);
        gl.uniform1i(at, unit);
      };
      uniforms.set(name, { set, sampler: true });
    }
    return uniforms;
  }

  // Makes a program current and sets its uniforms from values. Samplers without a value get a blank
  // texture.
  use(program, values) {
    this.gl.useProgram(program.id);
    for (const [name, uniform] of program.uniforms)
      if (uniform.sampler || values[name] !== undefined) uniform.set(values[name]);
  }

  // Makes a texture without content. It is unfiltered and clamped.
  texture(target, format, width, height, depth = 0) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(target, texture);
    if (depth > 0) gl.texStorage3D(target, 1, format, width, height, depth);
    else gl.texStorage2D(target, 1, format, width, height);
    this.filter(target, gl.NEAREST);
    return texture;
  }

  // Sets the filter of the texture that is bound, and clamps it.
  filter(target, how) {
    const gl = this.gl;
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, how);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, how);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
  }

  // Makes a depth texture for sampler2DShadow.
  depthMap(size) {
    const gl = this.gl, texture = this.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT32F, size, size);
    this.filter(gl.TEXTURE_2D, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL);
    return texture;
  }

  // Returns a texture to draw into, with a depth buffer of the format depth (0 means none). before
  // is the previous target or null. If it has the same size, it is returned. Otherwise it is freed.
  target(before, format, depth, width, height) {
    const gl = this.gl;
    if (before && before.width === width && before.height === height) return before;
    if (before) this.freeTarget(before);
    const target = { width, height, colour: this.texture(gl.TEXTURE_2D, format, width, height) };
    target.framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.colour, 0);
    if (depth) {
      target.depth = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, target.depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, depth, width, height);
      const to = depth === gl.DEPTH24_STENCIL8 ? gl.DEPTH_STENCIL_ATTACHMENT : gl.DEPTH_ATTACHMENT;
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, to, gl.RENDERBUFFER, target.depth);
    }
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE && !gl.isContextLost())
      throw new Error(`This device cannot draw ${width} × ${height} samples; make the window smaller.`);
    return target;
  }

  freeTarget(target) {
    this.gl.deleteFramebuffer(target.framebuffer);
    this.gl.deleteTexture(target.colour);
    this.gl.deleteRenderbuffer(target.depth || null);
  }

  // Draws the triangle of screen.vert, which covers the whole target.
  fillScreen() {
    const gl = this.gl;
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }
}
