// The local PCA of a material as textures. They have the same content as those of
// renderer/drawing/methods/lpca_revised.c, and are read by lpca_texel.glsl and lpca_revised.glsl.
import { floatOfHalf } from "./material_file.js";

// width and height of the faces of the cube maps of views and of lights
const viewSize = 256, lightSize = 512;

// Returns (s, t) of a direction on the elevated concentric map of direction_grid.h. Directions
// below the horizon are clamped to it.
function square(x, y, z, ret) {
  const rho = Math.sqrt(Math.min(Math.max(1 - z / Math.hypot(x, y, z), 0), 1)), quarter = Math.PI / 4;
  let phi = Math.atan2(y, x);
  if (phi < -quarter) phi += 2 * Math.PI;
  const side = Math.min(Math.floor((phi + quarter) / (2 * quarter)), 3);
  const across = rho * (phi - side * 2 * quarter) / quarter;
  ret[0] = 0.5 + 0.5 * [rho, -across, -rho, across][side];
  ret[1] = 0.5 + 0.5 * [across, rho, -across, -rho][side];
}

// Rounds to 16 bits, as in the cube maps of mesorig-view.
const sixteen = value => Math.round(value * 65535) / 65535;

export class LocalPca {
  constructor(gpu, material) {
    this.gpu = gpu;
    this.material = material;
    gpu.gl.pixelStorei(gpu.gl.UNPACK_ALIGNMENT, 1);
    gpu.gl.pixelStorei(gpu.gl.UNPACK_FLIP_Y_WEBGL, false);
    this.putClusters();
    this.putWeights();
    this.putVolumes();
    this.viewMap = this.cubeMap(viewSize, true, (at, ret) => {
      ret[0] = sixteen(at[0]);
      ret[1] = sixteen(at[1]);
    });
    const n = material.grid;
    this.lightMap = this.cubeMap(lightSize, false, (at, ret) => {
      const t = at[1] * (n - 1), s = 0.5 + at[0] * (n - 1), depth = n * n + 1;
      const i = Math.min(Math.floor(t), n - 2);
      ret[0] = sixteen((i * n + s) / depth);
      ret[1] = sixteen(((i + 1) * n + s) / depth);
      ret[2] = sixteen(t - i);
    });
  }

  get shaders() {
    return ["levels.glsl", "lpca_texel.glsl", "lpca_revised.glsl"];
  }

  // Whether the shaders need directions.glsl.
  get directions() {
    return false;
  }

  get constants() {
    const { components, levels } = this.material;
    return `#define N_COMPONENTS ${components}\n#define N_LEVELS ${levels.length}\n` +
      "#define NEAREST 0\n#define LOG 0\n";
  }

  get uniforms() {
    return {
      clusters: this.clusters, weights: this.weights, means: this.means, brdfs: this.brdfs,
      view_map: this.viewMap, light_map: this.lightMap, n_grid: this.material.grid,
      n_columns: this.columns,
    };
  }

  // Makes a texture without contents for all mip levels. Its texels are fetched and never filtered.
  levelled(target) {
    const gl = this.gpu.gl, texture = gl.createTexture();
    gl.bindTexture(target, texture);
    gl.texParameteri(target, gl.TEXTURE_MAX_LEVEL, this.material.levels.length - 1);
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST_MIPMAP_NEAREST);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }

  // Uploads the cluster of each texel together with those of its three neighbours to the right,
  // below, and diagonally, so that one fetch reads four clusters.
  putClusters() {
    const gl = this.gpu.gl, from = this.material.data.clusters;
    this.clusters = this.levelled(gl.TEXTURE_2D);
    let first = 0;
    this.material.levels.forEach(([w, h], level) => {
      const texels = new Uint16Array(4 * w * h);
      for (let k = 0; k < texels.length; k++) {
        const texel = k >> 2, i = (texel % w + (k & 1)) % w;
        const j = (Math.floor(texel / w) + ((k >> 1) & 1)) % h;
        texels[k] = from[first + j * w + i];
      }
      gl.texImage2D(gl.TEXTURE_2D, level, gl.RGBA16UI, w, h, 0, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT,
        texels);
      first += w * h;
    });
  }

  // Uploads the weights, multiplied by the scales of their clusters, with four components per
  // layer.
  putWeights() {
    const gl = this.gpu.gl, { components: n, levels, data } = this.material;
    const pages = Math.ceil(n / 4);
    this.weights = this.levelled(gl.TEXTURE_2D_ARRAY);
    let first = 0;
    levels.forEach(([w, h], level) => {
      const values = new Float32Array(4 * w * h * pages);
      for (let k = 0; k < w * h; k++)
        for (let i = 0; i < n; i++)
          values[4 * (w * h * (i >> 2) + k) + (i & 3)] = floatOfHalf(data.weights[n * (first + k) + i]) *
            data.scales[n * data.clusters[first + k] + i];
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, level, gl.RGBA32F, w, h, pages, 0, gl.RGBA, gl.FLOAT, values);
      first += w * h;
    });
  }

  volume(format, width, height, depth) {
    const gl = this.gpu.gl, texture = this.gpu.texture(gl.TEXTURE_3D, format, width, height, depth);
    this.gpu.filter(gl.TEXTURE_3D, gl.LINEAR);
    return texture;
  }

  // Uploads the samples of the means and of the eigen-BRDFs. this.columns is the number of clusters in
  // a row of both textures.
  putVolumes() {
    const gl = this.gpu.gl, { clusters, components, grid: n, data } = this.material;
    const most = this.gpu.largest3D, depth = n * n + 1, block = 3 * n * n * depth;
    this.columns = Math.min(clusters, Math.floor(most / n));
    const rows = Math.ceil(clusters / this.columns);
    if (rows * components * n > most || depth > most)
      throw new Error(`This device's 3D textures, ${most} each way, are too small for the material; ` +
        "export it with fewer clusters or components.");
    this.means = this.volume(gl.RGB16F, this.columns * n, rows * n, depth);
    for (let k = 0; k < clusters; k++)
      gl.texSubImage3D(gl.TEXTURE_3D, 0, k % this.columns * n, Math.floor(k / this.columns) * n, 0, n, n,
        depth, gl.RGB, gl.HALF_FLOAT, data.means.subarray(block * k, block * (k + 1)));
    this.brdfs = this.volume(gl.RGB8_SNORM, this.columns * n, rows * components * n, depth);
    for (let k = 0; k < clusters * components; k++) {
      const cluster = Math.floor(k / components);
      const row = Math.floor(cluster / this.columns) * components + k % components;
      gl.texSubImage3D(gl.TEXTURE_3D, 0, cluster % this.columns * n, row * n, 0, n, n, depth, gl.RGB,
        gl.BYTE, data.brdfs.subarray(block * k, block * (k + 1)));
    }
  }

  // Makes a cube map. fill computes a texel from (s, t) of its direction. The faces are in the
  // order of OpenGL.
  cubeMap(size, filtered, fill) {
    const gl = this.gpu.gl, texture = gl.createTexture(), at = [0, 0], one = [0, 0, 0];
    const halves = filtered && !this.gpu.filtersFloats;
    const format = halves ? gl.RGBA16F : gl.RGBA32F;
    gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
    const values = new Float32Array(4 * size * size);
    for (let face = 0; face < 6; face++) {
      for (let k = 0; k < size * size; k++) {
        const s = 2 * (k % size + 0.5) / size - 1, t = 2 * (Math.floor(k / size) + 0.5) / size - 1;
        const d = [[1, -t, -s], [-1, -t, s], [s, 1, t], [s, -1, -t], [s, -t, 1], [-s, -t, -1]][face];
        square(d[0], d[1], d[2], at);
        fill(at, one);
        values.set(one, 4 * k);
      }
      gl.texImage2D(gl.TEXTURE_CUBE_MAP_POSITIVE_X + face, 0, format, size, size, 0, gl.RGBA, gl.FLOAT,
        values);
    }
    this.gpu.filter(gl.TEXTURE_CUBE_MAP, filtered ? gl.LINEAR : gl.NEAREST);
    return texture;
  }

  free() {
    for (const texture of [this.clusters, this.weights, this.means, this.brdfs, this.viewMap, this.lightMap])
      this.gpu.gl.deleteTexture(texture);
  }
}
