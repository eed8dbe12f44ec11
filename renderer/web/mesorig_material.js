// A captured material in three.js. A MesorigMaterial is used like any other material of a mesh. It
// is lit by one light that is infinitely far away, and by an even sky.
import { CubeTexture, Data3DTexture, DataArrayTexture, GLSL3, Matrix4, RawShaderMaterial, Texture, Vector2, Vector3 } from "three";
import { Gpu, shaderText } from "./gpu.js";
import { LocalPca } from "./local_pca.js";
import { NeuralPlanes } from "./neural_planes.js";
import { Relief } from "./relief.js";
import { Mesh, shapeAttributes, shapeStride, vertexShapes } from "./shapes.js";

export { loadMaterial, readMaterial } from "./material_file.js";

const white = 0.8; // share of full scale of a white diffuser that is lit along its normal, at an exposure of 0 EV

// The main() of the fragment shader, which calls the main() of surface_relief.frag as
// shade_surface(). Converts to sRGB unless the output must stay linear light.
const ending = `
#undef main
uniform float exposure;
void main() {
    shade_surface();
    vec3 exposed = exposure * colour.rgb;
    colour = vec4(TONED == 1 ? srgb(tone(exposed)) + noise(gl_FragCoord.xy) / 255.0 : exposed,
                  1.0);
}
`;

// Removes the #version line, because three.js adds one.
const unversioned = text => text.slice(text.indexOf("\n") + 1);

// Adds the attributes that the shaders read in addition to position, normal and uv: tangent, if it
// is missing, scale (length of a step of 1 in u and in v), bend (second fundamental form) and stretch
// (gradients of ln scale).
// Returns position, normal, tangent and uv interleaved, as in shapes.js.
function completeGeometry(geometry) {
  if (!geometry.index) throw new Error("MesorigMaterial needs a geometry with an index; see mergeVertices().");
  if (!geometry.attributes.tangent) geometry.computeTangents();
  const { position, normal, tangent, uv } = geometry.attributes, n = position.count;
  const vertices = new Float32Array(12 * n);
  for (let k = 0; k < n; k++)
    vertices.set([position.getX(k), position.getY(k), position.getZ(k), normal.getX(k), normal.getY(k),
      normal.getZ(k), tangent.getX(k), tangent.getY(k), tangent.getZ(k), tangent.getW(k), uv.getX(k),
      uv.getY(k)], 12 * k);
  if (!geometry.attributes.stretch) {
    const shape = vertexShapes(vertices, geometry.index.array), Attribute = position.constructor;
    for (const [name, size, at] of shapeAttributes) {
      const values = new Float32Array(size * n);
      for (let k = 0; k < n; k++)
        values.set(shape.subarray(shapeStride * k + at, shapeStride * k + at + size), size * k);
      geometry.setAttribute(name, new Attribute(values, size));
    }
  }
  return vertices;
}

export class MesorigMaterial extends RawShaderMaterial {
  // renderer is a WebGLRenderer. material is a result of loadMaterial(). Settings, which can be changed
  // at any time:
  //   tiles          repetitions of the material along u and v
  //   light          Vector3 towards the light, in world coordinates
  //   brightness     of the light; 1 gives radiance 1 to a white diffuser that is lit along its normal
  //   ambient        radiance of the even sky
  //   exposure       in EV
  //   silhouettes    show the outlines of the material's structure, if its file has an MDF
  //   shadows        show the shadows that the mesh casts on itself
  //   layers         number of parts of the mesh that may lie behind each other
  //   shadowMap      width and height of the shadow map, in texels
  // The settings alongSurface and toned are only read here. alongSurface reads each measured view
  // where it shows the point that a ray meets, and needs silhouettes. toned: TRUE writes sRGB, for the canvas. FALSE writes linear light, for
  // a render target of floats.
  constructor(renderer, material, settings = {}) {
    super({ glslVersion: GLSL3 });
    this.renderer = renderer;
    this.settings = { tiles: [1, 1], light: new Vector3(0, 0, 1), brightness: 1, ambient: 0.05,
      exposure: 0.7, silhouettes: true, alongSurface: false, shadows: true, shadowMap: 1024, layers: 4, ...settings };
    this.captured = material;
    this.shared = new Map();
    this.meshes = new WeakMap();
    this.gpu = new Gpu(renderer.getContext());
    this.model = material.neural ? new NeuralPlanes(this.gpu, material) : new LocalPca(this.gpu, material);
    this.relief = new Relief(this.gpu, material);
    renderer.resetState();
    this.along = Boolean(this.settings.alongSurface && material.along);
    const constants = `#define CURVED 1\n#define ALONG ${this.along ? 1 : 0}\n#define LAMPS 0\n#define LAMP_SHADOWS 0\n` +
      "#define AMBIENT 1\n" +
      `#define TONED ${settings.toned === false ? 0 : 1}\n` + this.model.constants;
    this.vertexShader = unversioned(shaderText("", ["mesh.vert"]));
    this.fragmentShader = unversioned(shaderText(`${constants}#define main shade_surface\n`,
      ["frame.glsl", "places.glsl", ...(this.along || this.model.directions ? ["directions.glsl"] : []),
        ...this.model.shaders, "shadow.glsl", "further.glsl", "lamps.glsl", "visible.glsl", "curved.glsl", ...(this.along ? ["along.glsl"] : []),
        "surface_relief.frag", "tone.glsl"])) + ending;
    this.put({ clusters: Texture, weights: DataArrayTexture, means: Data3DTexture, brdfs: Data3DTexture,
      view_map: CubeTexture, light_map: CubeTexture,
      surface: DataArrayTexture, heights: Texture, planes: DataArrayTexture, skies: DataArrayTexture, seen: Texture, shadow_map: Texture,
      along_indices: Texture, along_weights: Texture, along_views: Texture, along_depths: DataArrayTexture },
    { ...this.model.uniforms, n_lamps: 0 });
  }

  // Sets uniforms. Textures of WebGL are wrapped in the texture classes of three.js. kinds has the
  // class of each sampler.
  put(kinds, values) {
    for (const [name, value] of Object.entries(values)) {
      const Kind = kinds[name], raw = Kind && (value || this.blankFor(name));
      this.uniforms[name] = this.uniforms[name] || { value: null };
      this.uniforms[name].value = Kind ? this.textureOf(Kind, raw) : value;
    }
    this.kinds = kinds;
    this.uniformsNeedUpdate = true;
  }

  blankFor(name) {
    return name === "shadow_map" ? this.gpu.blankDepth : this.gpu.blank;
  }

  textureOf(Kind, raw) {
    if (!this.shared.has(raw)) {
      const texture = new Kind();
      this.renderer.properties.get(texture).__webglTexture = raw;
      this.shared.set(raw, texture);
    }
    return this.shared.get(raw);
  }

  // Returns the Mesh of a geometry, which is made at the first call.
  meshOf(geometry) {
    if (!this.meshes.has(geometry)) {
      const { tiles, layers } = this.settings, gl = this.renderer.getContext();
      this.meshes.set(geometry, new Mesh(gl, completeGeometry(geometry), geometry.index.array, tiles, layers));
    }
    return this.meshes.get(geometry);
  }

  // Finds the visible and lit parts of the mesh. Call this function before each renderer.render().
  // object is the Mesh with this material. It may be moved, rotated or scaled evenly. The picture
  // must fill the canvas or the render target.
  prepare(object, camera) {
    const { renderer, settings } = this, mesh = this.meshOf(object.geometry);
    const target = renderer.getRenderTarget(), size = renderer.getDrawingBufferSize(new Vector2());
    object.updateWorldMatrix(true, false);
    camera.updateWorldMatrix(true, false);
    const view = new Matrix4().copy(camera.matrixWorld).invert();
    const projection = new Matrix4().multiplyMatrices(camera.projectionMatrix, view).multiply(object.matrixWorld);
    const back = new Matrix4().copy(object.matrixWorld).invert();
    const eye = new Vector3().setFromMatrixPosition(camera.matrixWorld).applyMatrix4(back).toArray();
    const light = settings.light.clone().transformDirection(back).toArray();
    const tiles = [...settings.tiles];
    this.relief.prepare({ mesh, tiles, projection: projection.elements, eye, light,
      width: target ? target.width : size.x, height: target ? target.height : size.y,
      silhouettes: settings.silhouettes, alongSurface: this.along, shadows: settings.shadows, shadowMap: settings.shadowMap });
    renderer.resetState();
    renderer.setRenderTarget(target);
    this.put(this.kinds, { ...this.relief.uniforms, projection: projection.elements.slice(), eye, light, tiles,
      lamp: settings.brightness, ambient_light: settings.ambient, exposure: white * 2 ** settings.exposure });
  }

  dispose() {
    this.model.free();
    this.relief.free();
    super.dispose();
  }
}
