// Silhouettes and cast shadows of a material's structure (Wang et al. 2005 §4), as in
// renderer/drawing/relief. prepare() finds the visible surface of each pixel and the shadow map.
// visible.glsl and shadow.glsl read both via uniforms.
import { cross, unit } from "./vectors.js";

const slack = 1e-4;      // tolerance of distances from the eye, in radii
const reach = 2;         // distance from the origin to the plane from which a lamp's depth is measured, in radii
const range = 4;         // length from depth 0 to depth 1, in radii
const shadowSlack = 2;   // depth bias, in texels of the map

// The MDF of a material as factors on the GPU, or a flat MDF if material is null.
class Mdf {
  constructor(gpu, material) {
    const gl = gpu.gl, mdf = material && material.mdf;
    this.layers = mdf ? mdf.layers : 0;
    this.size = mdf ? [mdf.width_mm, mdf.height_mm] : [1, 1];
    this.deepest = mdf ? mdf.deepest_mm : 0;
    const width = mdf ? mdf.width : 1, height = mdf ? mdf.height : 1, table = mdf ? mdf.table : 1;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    this.maps = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.maps);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, width, height, Math.max(this.layers, 1), 0, gl.RGBA,
      gl.UNSIGNED_BYTE, mdf ? material.data.mdf_maps : new Uint8Array(4));
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_NEAREST);
    this.factors = gpu.texture(gl.TEXTURE_2D_ARRAY, gl.RGBA16F, table, table, this.layers + 1);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, 0, table, table, this.layers + 1, gl.RGBA, gl.HALF_FLOAT,
      mdf ? material.data.mdf_factors : new Uint16Array(4));
    gpu.filter(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
  }

  get uniforms() {
    return { mdf_depths: this.maps, mdf_factors: this.factors, mdf_layers: this.layers,
      mdf_size: this.size, mdf_deepest: this.deepest };
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

  // scene has mesh, mdf, tiles, projection, sight, reach, width and height. Returns a texture with
  // four values per pixel: the distance from the eye to the mesh, the distance along the ray from
  // the mesh to the structure, the distance from the mesh to the base of the structure, and 1. All
  // four are 0 where nothing is seen.
  find(scene) {
    const { gpu } = this, gl = gpu.gl, { width, height, mesh } = scene;
    const before = ["mesh.vert", "frame.glsl", "places.glsl", "directions.glsl", "sight.glsl",
      "curved.glsl", "relief.glsl"];
    const constants = "#define MDF_MAPS 1\n";
    const backs = gpu.program(constants, [...before, "peel_back.frag"]);
    const fronts = gpu.program(constants, [...before, "peel_front.frag"]);
    const values = { ...scene.mdf.uniforms, projection: scene.projection, tiles: scene.tiles,
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
    this.mdf = material.mdf ? new Mdf(gpu, material) : null;
    this.smooth = new Mdf(gpu, null);
    this.eye = new Visibility(gpu);
    this.lamp = new Visibility(gpu);
    this.uniforms = {};
  }

  // scene has mesh, tiles, projection, eye, light, width, height, silhouettes, shadows and
  // shadowMap. Leaves another framebuffer bound. The results are in this.uniforms.
  prepare(scene) {
    const { mesh, tiles, light } = scene, silhouettes = scene.silhouettes && this.mdf !== null;
    const mdf = silhouettes ? this.mdf : this.smooth;
    let seen = null;
    if (silhouettes)
      seen = this.eye.find({ mesh, tiles, mdf, projection: scene.projection, sight: [...scene.eye, 1],
        reach: 0, width: scene.width, height: scene.height });
    if (scene.shadows) this.findShadow(mesh, tiles, mdf, light, scene.shadowMap);
    this.uniforms = {
      seen, silhouettes, slack: slack * mesh.radius,
      shadows: scene.shadows, shadow_map: scene.shadows ? this.shadowMap : null,
      shadow_light: light, shadow_right: rightOf(light), shadow_radius: mesh.radius,
      shadow_range: [reach * mesh.radius, range * mesh.radius,
        shadowSlack * 2 * mesh.radius / scene.shadowMap],
    };
  }

  // Draws the shadow map, unless lamp, mesh, tiles, MDF and size are the same as in the last call.
  findShadow(mesh, tiles, mdf, light, size) {
    const gl = this.gpu.gl, key = [...light, ...tiles, size];
    if (this.key && this.key.mesh === mesh && this.key.mdf === mdf &&
        key.every((x, k) => x === this.key.values[k])) return;
    if (this.size !== size) {
      gl.deleteTexture(this.shadowMap || null);
      this.shadowMap = this.gpu.depthMap(size);
      this.shadowFrame = this.shadowFrame || gl.createFramebuffer();
      this.size = size;
    }
    const seen = this.lamp.find({ mesh, tiles, mdf, projection: lampMatrix(light, mesh.radius),
      sight: [...light, 0], reach: reach * mesh.radius, width: size, height: size });
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadowMap, 0);
    gl.drawBuffers([gl.NONE]);
    gl.depthFunc(gl.ALWAYS);
    this.gpu.use(this.gpu.program("", ["screen.vert", "shadow_map.frag"]),
      { seen, range: range * mesh.radius });
    this.gpu.fillScreen();
    gl.depthFunc(gl.LESS);
    this.key = { mesh, mdf, values: key };
  }

  free() {
    const gl = this.gpu.gl;
    this.eye.free();
    this.lamp.free();
    for (const mdf of [this.mdf, this.smooth]) {
      if (!mdf) continue;
      gl.deleteTexture(mdf.maps);
      gl.deleteTexture(mdf.factors);
    }
    gl.deleteTexture(this.shadowMap || null);
    gl.deleteFramebuffer(this.shadowFrame || null);
  }
}
