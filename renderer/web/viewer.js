// Draws a material on a shape as mesorig-view does (renderer/scene/viewer.c).
import { cameraMatrix, fitCamera } from "./camera.js";
import { Gpu } from "./gpu.js";
import { LocalPca } from "./local_pca.js";
import { NeuralPlanes } from "./neural_planes.js";
import { Relief } from "./relief.js";
import { Mesh } from "./shapes.js";
import { directionFromDeg } from "./vectors.js";

const white = 0.8; // share of full scale of a white diffuser that is lit along its normal, at an exposure of 0 EV

// The default settings. Settings have the names and meanings of mesorig-view's options.
export const defaults = {
  shape: "torus",
  tiles: null, // null means the numbers of the shape
  cameraAzimuthDeg: -90,
  cameraElevationDeg: 40,
  cameraDistance: 0, // 0 means that the shape fills the picture
  cameraPan: [0, 0],
  cameraFovDeg: 30,
  lightThetaDeg: 50,
  lightPhiDeg: 200,
  lightBrightness: 1,
  exposure: 0.7,
  ambient: 0.05,
  silhouettes: true,
  alongSurface: false,
  shadows: true,
  shadowMap: 1024,
  supersample: 1,
};

// Returns the footprint of a mesh (its lowest quarter seen from above) as a rectangle with rounded
// corners.
function footOf(mesh) {
  const p = mesh.points;
  let reach = 0, x = 0, y = 0, low = 0, high = 0;
  for (let k = 2; k < p.length; k += 3) {
    low = Math.min(low, p[k]);
    high = Math.max(high, p[k]);
  }
  for (let k = 0; k < p.length; k += 3) {
    if (p[k + 2] > low + 0.25 * (high - low)) continue;
    x = Math.max(x, Math.abs(p[k]));
    y = Math.max(y, Math.abs(p[k + 1]));
    reach = Math.max(reach, Math.hypot(p[k], p[k + 1]));
  }
  const side = Math.min(x, y);
  const missing = (Math.hypot(x, y) - reach) / (Math.max(side, 1e-6) * (Math.SQRT2 - 1));
  return { foot: [x, y, low], corner: side * Math.min(Math.max(missing, 0), 1), radius: mesh.radius };
}

export class Viewer {
  // gl is a WebGL2RenderingContext. material is a result of readMaterial().
  constructor(gl, material) {
    this.gl = gl;
    this.gpu = new Gpu(gl);
    this.material = material;
    this.model = material.neural ? new NeuralPlanes(this.gpu, material) : new LocalPca(this.gpu, material);
    this.relief = new Relief(this.gpu, material);
  }

  setShape(name) {
    if (this.shape === name) return;
    if (this.mesh) this.mesh.free();
    this.mesh = Mesh.named(this.gl, name);
    this.foot = footOf(this.mesh);
    this.shape = name;
  }

  // Returns settings with the distance and pan at which the shape fills a picture of this aspect.
  // If the settings have a distance, they are returned unchanged.
  fitted(settings, aspect) {
    if (settings.cameraDistance > 0) return settings;
    return { ...settings, ...fitCamera(settings, this.mesh.points, this.mesh.radius, aspect) };
  }

  // Draws linear light into this.scene.
  drawScene(s, width, height) {
    const { gl, gpu, mesh, relief } = this;
    const { projection, eye } = cameraMatrix(this.fitted(s, width / height), mesh.radius, width / height);
    const light = directionFromDeg(s.lightThetaDeg, s.lightPhiDeg), tiles = s.tiles || mesh.tiles;
    const structured = s.silhouettes && this.material.shell, relieved = structured || s.shadows;
    const along = structured && s.alongSurface && this.material.along;
    relief.prepare({ mesh, tiles, projection, eye, light, width, height, silhouettes: structured,
      alongSurface: along, shadows: s.shadows && s.lightBrightness > 0, shadowMap: s.shadowMap });
    const names = relieved
      ? ["shadow.glsl", "further.glsl", "lamps.glsl", "visible.glsl", "curved.glsl", ...(along ? ["along.glsl"] : []),
        "surface_relief.frag"]
      : ["further.glsl", "lamps.glsl", "surface.frag"];
    const constants = `#define CURVED ${relieved ? 1 : 0}\n#define ALONG ${along ? 1 : 0}\n#define LAMPS 0\n#define LAMP_SHADOWS 0\n` +
      `#define AMBIENT ${s.ambient > 0 ? 1 : 0}\n`;
    const program = gpu.program(constants + this.model.constants,
      ["mesh.vert", "frame.glsl", "places.glsl", ...(along || this.model.directions ? ["directions.glsl"] : []),
        ...this.model.shaders, ...names]);
    this.scene = gpu.target(this.scene, gl.RGBA16F, gl.DEPTH_COMPONENT24, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.scene.framebuffer);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const values = { ...relief.uniforms, projection, tiles, eye, light, lamp: s.lightBrightness };
    gpu.use(program, { ...values, ...this.model.uniforms, ambient_light: s.ambient, n_lamps: 0 });
    mesh.draw();
    const ground = gpu.program("#define LAMP_SHADOWS 0\n",
      ["screen.vert", "shadow.glsl", "further.glsl", "background.frag"]);
    gl.depthFunc(gl.LEQUAL); // only where nothing was drawn yet
    gl.depthMask(false);
    gpu.use(ground, { ...values, ...this.foot });
    gpu.fillScreen();
    gl.depthMask(true);
    gl.depthFunc(gl.LESS);
  }

  // Draws sRGB into a framebuffer. null means the canvas.
  draw(settings, framebuffer, width, height) {
    const s = { ...defaults, ...settings }, { gl, gpu } = this;
    this.setShape(s.shape);
    this.drawScene(s, width * s.supersample, height * s.supersample);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.DEPTH_TEST);
    gpu.use(gpu.program("", ["screen.vert", "tone.glsl", "resolve.frag"]),
      { drawn: this.scene.colour, samples: s.supersample, exposure: white * 2 ** s.exposure });
    gpu.fillScreen();
  }

  // Returns the picture as an ImageData.
  picture(settings, width, height) {
    const gl = this.gl, target = this.gpu.target(null, gl.RGBA8, 0, width, height);
    const upside = new Uint8Array(4 * width * height), image = new ImageData(width, height);
    this.draw(settings, target.framebuffer, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, upside);
    for (let j = 0; j < height; j++)
      image.data.set(upside.subarray(4 * width * (height - 1 - j), 4 * width * (height - j)), 4 * width * j);
    this.gpu.freeTarget(target);
    return image;
  }
}
