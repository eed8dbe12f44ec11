// The neural planes of a material as textures. They have the same content as those of
// renderer/drawing/methods/neural_view.c, and are read by neural.glsl.
export class NeuralPlanes {
  constructor(gpu, material) {
    const gl = gpu.gl, { levels: [[w, h]], neural, data } = material, layers = neural.channels / 4;
    if (2 * Math.max(w, h) > gpu.largest)
      throw new Error(`This device's textures, ${gpu.largest} each way, are too small for the material; use another one.`);
    this.gpu = gpu;
    this.material = material;
    this.levels = 1 + Math.floor(Math.log2(Math.max(w, h)));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    this.surface = this.texture(gl.TEXTURE_2D_ARRAY);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, w, h, layers, 0, gl.RGBA, gl.UNSIGNED_BYTE, data.surface);
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    this.heights = this.texture(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAX_LEVEL, this.levels - 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16F, 2 * w, 2 * h, 0, gl.RED, gl.FLOAT, Float32Array.from(data.heights));
    gl.generateMipmap(gl.TEXTURE_2D);
    const [columns, rows] = neural.sky, views = data.sky.length / (3 * columns * rows);
    this.skies = this.texture(gl.TEXTURE_2D_ARRAY);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.R11F_G11F_B10F, columns, rows, views, 0, gl.RGB, gl.HALF_FLOAT, data.sky);
    gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    this.planes = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.planes);
    const side = neural.plane, depth = data.planes.length / (4 * side * side);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gpu.filtersFloats ? gl.RGBA32F : gl.RGBA16F, side, side, depth, 0, gl.RGBA,
      gl.FLOAT, data.planes);
    gpu.filter(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
    this.network = new TextDecoder().decode(data.network);
  }

  get shaders() {
    return ["levels.glsl", "neural.glsl"];
  }

  // Whether the shaders need directions.glsl.
  get directions() {
    return true;
  }

  get constants() {
    return `#define N_CHANNELS ${this.material.neural.channels}\n#define N_LEVELS ${this.levels}\n` +
      `#define N_RAYS 1\n#define NEAREST 0\n${this.network}`;
  }

  get uniforms() {
    return { surface: this.surface, heights: this.heights, planes: this.planes, skies: this.skies,
      height_scale: this.material.neural.heights };
  }

  // Makes a texture that repeats and has mip levels.
  texture(target) {
    const gl = this.gpu.gl, texture = gl.createTexture();
    gl.bindTexture(target, texture);
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, axis, gl.REPEAT);
    return texture;
  }

  free() {
    for (const texture of [this.surface, this.heights, this.planes, this.skies]) this.gpu.gl.deleteTexture(texture);
  }
}
