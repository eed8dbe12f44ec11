// Silhouettes and cast shadows of a material's structure (Wang et al. 2005 §4), as in
// renderer/drawing/relief. prepare() finds the visible surface of each pixel and the shadow map.
// visible.glsl and shadow.glsl read both via uniforms.
import { cross, unit } from "./vectors.js";

const slack = 1e-4;      // tolerance of distances from the eye, in radii
const reach = 2;         // distance from the origin to the plane from which a lamp's depth is measured, in radii
const range = 4;         // length from depth 0 to depth 1, in radii
const shadowSlack = 2;   // depth bias, in texels of the map

// Returns the next mip level of a shell: the root of the mean square over each 2 × 2 voxels of a
// layer, as halve_shell() in renderer/drawing/relief/mdf_texture.c. A Uint8ClampedArray rounds to the
// nearest integer.
function halveShell(values, w, h, depth) {
  const toW = Math.max(w >> 1, 1), toH = Math.max(h >> 1, 1);
  const ret = new Uint8ClampedArray(toW * toH * depth);
  for (let at = 0; at < ret.length; at++) {
    const i = at % toW, j = Math.floor(at / toW) % toH, layer = Math.floor(at / (toW * toH));
    let sum = 0;
    for (let k = 0; k < 4; k++) {
      const x = Math.min(2 * i + (k & 1), w - 1), y = Math.min(2 * j + (k >> 1), h - 1);
      sum += values[(layer * h + y) * w + x] ** 2;
    }
    ret[at] = Math.sqrt(sum / 4);
  }
  return ret;
}

// A smooth surface: its structure is 0 mm deep.
const smooth = { width: 1, height: 1, depth: 1, width_mm: 1, height_mm: 1, depth_mm: 0, top_mm: 0, most_per_mm: 0 };

// The shell of a material's MDF (processing/mdf/mdf_shell.h) on the GPU.
class Shell {
  // shell is that of the header of a material. values has a byte per voxel.
  constructor(gpu, shell, values) {
    const gl = gpu.gl, { depth } = shell;
    let { width: w, height: h } = shell;
    if (Math.max(w, h) > gpu.largest || depth > gpu.mostLayers)
      throw new Error(`The material's shell of ${w} × ${h} × ${depth} voxels is too large for this device, whose ` +
        `textures have ${gpu.largest} × ${gpu.largest} texels in ${gpu.mostLayers} layers; use another device.`);
    this.texture = gl.createTexture();
    this.size = [shell.width_mm, shell.height_mm];
    this.uniforms = { mdf_shell: this.texture, mdf_most_per_mm: shell.most_per_mm, mdf_top: shell.top_mm,
      mdf_size: this.size, mdf_deepest: shell.depth_mm };
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.texture);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
    for (let level = 0; ; level++) {
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, level, gl.R8, w, h, depth, 0, gl.RED, gl.UNSIGNED_BYTE, values);
      if (w === 1 && h === 1) break;
      values = halveShell(values, w, h, depth);
      w = Math.max(w >> 1, 1);
      h = Math.max(h >> 1, 1);
    }
  }
}

// Finds the visible surface by peeling layers (Wang et al. 2005 fig. 7): first the back faces of a
// layer, then the front faces before them.
class Visibility {
  constructor(gpu) {
    this.gpu = gpu;
    this.back = [null, null];
  }

  clear(target, what) {
    const gl = this.gpu.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(what);
  }

  drawFaces(mesh, culled, program, values) {
    const gl = this.gpu.gl;
    this.gpu.use(program, values);
    gl.enable(gl.CULL_FACE);
    gl.cullFace(culled);
    mesh.draw();
    gl.disable(gl.CULL_FACE);
  }

  // scene has mesh, shell, tiles, projection, sight, reach, width and height. Returns a texture with
  // four values per pixel: the distance from the eye to the mesh, the distance along the ray from
  // the mesh to the structure, the distance from the mesh to the base of the structure, and 1. All
  // four are 0 where nothing is seen.
  find(scene) {
    const { gpu } = this, gl = gpu.gl, { width, height, mesh } = scene;
    const before = ["mesh.vert", "frame.glsl", "places.glsl", "directions.glsl", "sight.glsl",
      "curved.glsl", "meets.glsl", "relief.glsl", "shell.glsl"];
    const constants = "#define CURVED 0\n#define MDF_SHELL 1\n";
    const backs = gpu.program(constants, [...before, "peel_back.frag"]);
    const fronts = gpu.program(constants, [...before, "peel_front.frag"]);
    const values = { ...scene.shell.uniforms, projection: scene.projection, tiles: scene.tiles,
      sight: scene.sight, reach: scene.reach, straight: false };
    this.back = this.back.map(
      target => gpu.target(target, gl.RGBA32F, gl.DEPTH_COMPONENT24, width, height));
    this.seen = gpu.target(this.seen, gl.RGBA32F, gl.DEPTH24_STENCIL8, width, height);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.stencilMask(0xff);
    gl.clearStencil(0xff);
    this.clear(this.seen, gl.COLOR_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    this.clear(this.back[1], gl.COLOR_BUFFER_BIT);
    for (let layer = 0; layer < mesh.layers; layer++) {
      const now = this.back[layer & 1], last = this.back[~layer & 1];
      this.clear(now, gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      this.drawFaces(mesh, gl.FRONT, backs, { ...values, before: last.colour, seen: this.seen.colour });
      // The stencil buffer keeps the layer in which the surface of a pixel was found, and masks the
      // pixel in all later layers.
      this.clear(this.seen, gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.STENCIL_TEST);
      gl.stencilFunc(gl.LEQUAL, layer, 0xff);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
      this.drawFaces(mesh, gl.BACK, fronts, { ...values, before: last.colour, back: now.colour });
      gl.disable(gl.STENCIL_TEST);
    }
    return this.seen.colour;
  }

  free() {
    for (const target of [...this.back, this.seen]) if (target) this.gpu.freeTarget(target);
  }
}

// Returns the direction of a shadow map's +x. Its +y is towards × right.
function rightOf(towards) {
  return unit(cross(Math.abs(towards[2]) > 0.9 ? [0, 1, 0] : [0, 0, 1], towards));
}

// Returns the matrix of a parallel projection along the light. A sphere of the radius around the
// origin fills the picture.
function lampMatrix(light, radius) {
  const right = rightOf(light), up = cross(light, right), ret = new Array(16).fill(0);
  for (let k = 0; k < 3; k++) {
    ret[4 * k] = right[k] / radius;
    ret[4 * k + 1] = up[k] / radius;
    ret[4 * k + 2] = -light[k] / radius;
  }
  ret[15] = 1;
  return ret;
}

export class Relief {
  constructor(gpu, material) {
    this.gpu = gpu;
    this.shell = material.shell ? new Shell(gpu, material.shell, material.data.shell) : null;
    this.smooth = new Shell(gpu, smooth, new Uint8Array(1));
    this.eye = new Visibility(gpu);
    this.lamp = new Visibility(gpu);
    this.uniforms = {};
  }

  // scene has mesh, tiles, projection, eye, light, width, height, silhouettes, shadows and
  // shadowMap. Leaves another framebuffer bound. The results are in this.uniforms.
  prepare(scene) {
    const { mesh, tiles, light } = scene, silhouettes = scene.silhouettes && this.shell !== null;
    const shell = silhouettes ? this.shell : this.smooth;
    let seen = null;
    if (silhouettes)
      seen = this.eye.find({ mesh, tiles, shell, projection: scene.projection, sight: [...scene.eye, 1],
        reach: 0, width: scene.width, height: scene.height });
    if (scene.shadows) this.findShadow(mesh, tiles, shell, light, scene.shadowMap);
    this.uniforms = {
      seen, silhouettes, slack: slack * mesh.radius, curved: silhouettes, mdf_size: shell.size,
      shadows: scene.shadows, shadow_map: scene.shadows ? this.shadowMap : null,
      shadow_light: light, shadow_right: rightOf(light), shadow_radius: mesh.radius,
      shadow_range: [reach * mesh.radius, range * mesh.radius,
        shadowSlack * 2 * mesh.radius / scene.shadowMap],
    };
  }

  // Draws the shadow map, unless lamp, mesh, tiles, shell and size are the same as in the last call.
  findShadow(mesh, tiles, shell, light, size) {
    const gl = this.gpu.gl, key = [...light, ...tiles, size];
    if (this.key && this.key.mesh === mesh && this.key.shell === shell &&
        key.every((x, k) => x === this.key.values[k])) return;
    if (this.size !== size) {
      gl.deleteTexture(this.shadowMap || null);
      this.shadowMap = this.gpu.depthMap(size);
      this.shadowFrame = this.shadowFrame || gl.createFramebuffer();
      this.size = size;
    }
    const seen = this.lamp.find({ mesh, tiles, shell, projection: lampMatrix(light, mesh.radius),
      sight: [...light, 0], reach: reach * mesh.radius, width: size, height: size });
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadowMap, 0);
    gl.drawBuffers([gl.NONE]);
    gl.depthFunc(gl.ALWAYS);
    this.gpu.use(this.gpu.program("", ["screen.vert", "shadow_map.frag"]),
      { seen, range: range * mesh.radius });
    this.gpu.fillScreen();
    gl.depthFunc(gl.LESS);
    this.key = { mesh, shell, values: key };
  }

  free() {
    const gl = this.gpu.gl;
    this.eye.free();
    this.lamp.free();
    for (const shell of [this.shell, this.smooth]) if (shell) gl.deleteTexture(shell.texture);
    gl.deleteTexture(this.shadowMap || null);
    gl.deleteFramebuffer(this.shadowFrame || null);
  }
}
