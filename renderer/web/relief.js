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

// Returns the point of the stereographic plane, seen from the nadir, to which a direction belongs.
const stereographic = ([x, y, z]) => [x / (1 + z), y / (1 + z)];

// Returns twice the area of a triangle, which is positive if its corners are counter-clockwise.
const area = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);

// The triangulation of the measured views, as in processing/directions. points has the views in the
// stereographic plane. corners has three views per triangle, counter-clockwise.
class Triangulation {
  constructor(points, corners) {
    this.points = points;
    this.corners = corners;
    this.last = 0; // the triangle that was found last
    const edges = new Set();
    corners.forEach((from, k) => edges.add(`${from},${corners[k % 3 === 2 ? k - 2 : k + 1]}`));
    // edges of one triangle only, which are the border
    this.border = [...edges].map(edge => edge.split(",").map(Number)).filter(([a, b]) => !edges.has(`${b},${a}`));
  }

  // Puts the barycentric weights of p in a triangle into ret. Returns whether p lies in it.
  weigh(p, triangle, ret) {
    const [i, j, k] = this.corners.subarray(3 * triangle, 3 * triangle + 3);
    const a = this.points[i], b = this.points[j], c = this.points[k], whole = area(a, b, c);
    ret.views = [i, j, k];
    ret.weights = [area(p, b, c) / whole, area(a, p, c) / whole, area(a, b, p) / whole];
    return ret.weights.every(weight => weight >= -1e-9);
  }

  // Returns the three views around p and their weights. A point outside of all triangles has the
  // weights of the nearest point of the border, which is convex.
  find(p) {
    const { points, border } = this, ret = {};
    if (border.every(([i, j]) => area(points[i], points[j], p) >= 0)) {
      const n = this.corners.length / 3;
      for (let k = 0; k < n; k++) {
        const triangle = (this.last + k) % n;
        if (!this.weigh(p, triangle, ret)) continue;
        this.last = triangle;
        break;
      }
      return ret;
    }
    let least = Infinity;
    for (const [i, j] of border) {
      const [x, y] = points[i], dx = points[j][0] - x, dy = points[j][1] - y;
      const share = Math.min(Math.max(((p[0] - x) * dx + (p[1] - y) * dy) / (dx * dx + dy * dy), 0), 1);
      const away = Math.hypot(x + share * dx - p[0], y + share * dy - p[1]);
      if (away >= least) continue;
      least = away;
      ret.views = [i, j, j];
      ret.weights = [1 - share, share, 0];
    }
    return ret;
  }
}

// Makes the textures of along.glsl, which have the directions, depths and triangulation of the
// measured views of the MDF. The table of the triangulation has the same content as that of
// renderer/drawing/gl/direction_table.c. along is that of the header of a material. Returns uniforms.
function alongUniforms(gpu, { along, depths, directions, triangles }, deepest_mm) {
  const gl = gpu.gl, n = along.views, size = 512, views = new Float32Array(4 * n), points = [];
  if (Math.max(along.width, along.height) > gpu.largest || n > Math.min(gpu.largest, gpu.mostLayers))
    throw new Error(`The material's ${n} views of ${along.width} × ${along.height} texels are too large for this ` +
      `device, whose textures have ${gpu.largest} × ${gpu.largest} texels in ${gpu.mostLayers} layers; use another device.`);
  for (let k = 0; k < n; k++) {
    views.set(directions.subarray(3 * k, 3 * k + 3), 4 * k);
    points.push(stereographic(directions.subarray(3 * k, 3 * k + 3)));
  }
  const triangulation = new Triangulation(points, triangles);
  const indices = new Uint16Array(4 * size * size), weights = new Float32Array(4 * size * size);
  for (let at = 0; at < size * size; at++) {
    const a = -1 + 2 * (at % size + 0.5) / size, b = -1 + 2 * (Math.floor(at / size) + 0.5) / size;
    const x = (a + b) / 2, y = (a - b) / 2;
    const found = triangulation.find(stereographic(unit([x, y, Math.max(1 - Math.abs(x) - Math.abs(y), 0)])));
    indices.set([...found.views, found.views[0]], 4 * at);
    weights.set(found.weights, 4 * at);
  }
  const texture = (format, w, h, from, kind, values) => {
    const ret = gpu.texture(gl.TEXTURE_2D, format, w, h);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, w, h, from, kind, values);
    return ret;
  };
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  const ret = {
    along_indices: texture(gl.RGBA16UI, size, size, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, indices),
    along_weights: texture(gl.RGBA32F, size, size, gl.RGBA, gl.FLOAT, weights),
    along_views: texture(gl.RGBA32F, n, 1, gl.RGBA, gl.FLOAT, views),
    along_depths: gl.createTexture(),
    along_mm: deepest_mm,
  };
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, ret.along_depths);
  gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
  gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.R8, along.width, along.height, n, 0, gl.RED, gl.UNSIGNED_BYTE, depths);
  gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
  return ret;
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
    const { depths, directions, triangles } = material.data;
    this.views = material.along ? { along: material.along, depths, directions, triangles } : null;
    this.along = null; // uniforms of along.glsl
    this.smooth = new Shell(gpu, smooth, new Uint8Array(1));
    this.eye = new Visibility(gpu);
    this.lamp = new Visibility(gpu);
    this.uniforms = {};
  }

  // scene has mesh, tiles, projection, eye, light, width, height, silhouettes, alongSurface, shadows
  // and shadowMap. Leaves another framebuffer bound. The results are in this.uniforms.
  prepare(scene) {
    const { mesh, tiles, light } = scene, silhouettes = scene.silhouettes && this.shell !== null;
    const shell = silhouettes ? this.shell : this.smooth;
    let seen = null;
    if (silhouettes)
      seen = this.eye.find({ mesh, tiles, shell, projection: scene.projection, sight: [...scene.eye, 1],
        reach: 0, width: scene.width, height: scene.height });
    if (scene.alongSurface && this.views) {
      this.along = alongUniforms(this.gpu, this.views, this.shell.uniforms.mdf_deepest);
      this.views = null;
    }
    if (scene.shadows) this.findShadow(mesh, tiles, shell, light, scene.shadowMap);
    this.uniforms = {
      seen, silhouettes, slack: slack * mesh.radius, curved: silhouettes, mdf_size: shell.size,
      shadows: scene.shadows, shadow_map: scene.shadows ? this.shadowMap : null,
      shadow_light: light, shadow_right: rightOf(light), shadow_radius: mesh.radius,
      shadow_range: [reach * mesh.radius, range * mesh.radius,
        shadowSlack * 2 * mesh.radius / scene.shadowMap],
      ...this.along,
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
    for (const name of this.along ? ["along_indices", "along_weights", "along_views", "along_depths"] : [])
      gl.deleteTexture(this.along[name]);
    gl.deleteTexture(this.shadowMap || null);
    gl.deleteFramebuffer(this.shadowFrame || null);
  }
}
