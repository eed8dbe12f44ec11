// The page converts drags and choices of the user to settings of the viewer.
import { readMaterial } from "./material_file.js";
import { shapeNames } from "./shapes.js";
import { Viewer, defaults } from "./viewer.js";

const $ = id => document.getElementById(id);
const canvas = $("picture");
const slowMs = 60;  // if a picture takes longer, it is drawn at a lower resolution while something moves
const fastMs = 250; // if a picture took less than this, it is drawn with supersampling at rest
const turnDeg = 0.35; // rotation per pixel of movement, in degrees

// first: the settings at the start. coarse: share of the resolution in each direction at which the
// picture is drawn while something moves. asked: a frame has been requested. restless: timer that
// draws at full quality when nothing moves.
let viewer = null, settings = null, first = null;
let coarse = 1, asked = false, restless = 0;

// Reads options of mesorig-view from the address of the page, for example
// #shape=sphere&light-theta-deg=30. A material with one view is first shown as it was measured: on
// a plane, from above.
function fromAddress(views) {
  const ret = { ...defaults };
  if (views === 1) Object.assign(ret, { shape: "plane", cameraElevationDeg: 90 });
  for (const [option, text] of new URLSearchParams(location.hash.slice(1))) {
    const key = option.replace(/-(.)/g, (_, letter) => letter.toUpperCase());
    const numbers = text.split(/[,x]/).map(Number), known = defaults[key];
    if (key === "shape" ? shapeNames.includes(text) : false) ret.shape = text;
    else if (typeof known === "boolean") ret[key] = text !== "0" && text !== "no";
    else if (numbers.some(x => !Number.isFinite(x))) continue;
    else if (typeof known === "number") ret[key] = numbers[0];
    else if (key === "cameraPan" || key === "tiles") ret[key] = numbers.length === 2 ? numbers : known;
  }
  return ret;
}

const aspect = () => canvas.clientWidth / Math.max(canvas.clientHeight, 1);

// Draws into the canvas at a share of its resolution in each direction. Returns the time that it
// took, in milliseconds.
function drawNow(share, supersample) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2) * share, begun = performance.now();
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  viewer.draw({ ...settings, supersample }, null, width, height);
  viewer.gl.readPixels(0, 0, 1, 1, viewer.gl.RGBA, viewer.gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the GPU
  return performance.now() - begun;
}

// Draws in the next frame, at a lower resolution if drawing takes long. Draws at full quality when
// nothing has moved for a while.
function redraw() {
  clearTimeout(restless);
  restless = setTimeout(() => {
    if (viewer && drawNow(1, 1) < fastMs) drawNow(1, 2);
  }, 200);
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    if (!viewer) return;
    const took = drawNow(coarse, 1);
    if (took > slowMs) coarse = Math.max(0.25, coarse * 0.7);
    else if (took < slowMs / 4) coarse = Math.min(1, coarse / 0.7);
  });
}

function change(what) {
  Object.assign(settings, what);
  redraw();
}

const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// Stores the distance and pan of the camera in the settings, so that they no longer depend on the
// aspect of the picture.
function holdCamera() {
  viewer.setShape(settings.shape);
  settings = viewer.fitted(settings, aspect());
}

// Turns the camera by angles in degrees: about the vertical axis, and upwards.
function turnCamera(right, down) {
  holdCamera();
  change({ cameraAzimuthDeg: settings.cameraAzimuthDeg - right,
    cameraElevationDeg: clamp(settings.cameraElevationDeg + down, -90, 90) });
}

// Turns the light by angles in degrees: about the vertical axis, and away from the zenith.
function turnLight(right, down) {
  change({ lightPhiDeg: settings.lightPhiDeg + right,
    lightThetaDeg: clamp(settings.lightThetaDeg + down, 0, 180) });
}

function zoom(factor) {
  holdCamera();
  change({ cameraDistance: clamp(settings.cameraDistance * factor, 0.3, 30) });
}

// The pointers that are pressed, by their id: position, and whether they move the light.
const fingers = new Map();

// Returns the distance between two fingers in pixels.
function spread() {
  const [a, b] = [...fingers.values()];
  return Math.hypot(a.x - b.x, a.y - b.y);
}

function listenToCanvas() {
  const dragged = () => document.querySelector("[name=drag]:checked").value;
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    const light = event.button === 2 || event.shiftKey || dragged() === "light";
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY, light });
  });
  canvas.addEventListener("pointermove", event => {
    const finger = fingers.get(event.pointerId);
    if (!finger) return;
    const before = fingers.size === 2 ? spread() : 0;
    const right = turnDeg * (event.clientX - finger.x), down = turnDeg * (event.clientY - finger.y);
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    if (fingers.size === 2) zoom(before / Math.max(spread(), 1));
    else if (finger.light) turnLight(right, down);
    else turnCamera(right, down);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
    canvas.addEventListener(end, event => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY, -100, 100) / 500));
  }, { passive: false });
  canvas.addEventListener("keydown", event => {
    const turn = event.shiftKey ? turnLight : turnCamera, step = 5;
    const keys = {
      ArrowLeft: () => turn(-step, 0), ArrowRight: () => turn(step, 0),
      ArrowUp: () => turn(0, -step), ArrowDown: () => turn(0, step),
      "+": () => zoom(0.9), "-": () => zoom(1 / 0.9),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  canvas.addEventListener("webglcontextlost", event => {
    event.preventDefault();
    viewer = null;
    fail(new Error("The graphics card was taken from this page; load it again."));
  });
}

function addShapes() {
  for (const name of shapeNames) {
    const label = document.createElement("label"), input = document.createElement("input");
    const text = document.createElement("span");
    Object.assign(input, { type: "radio", name: "shape", value: name });
    text.textContent = name.replace("-", " ");
    label.append(input, text);
    label.addEventListener("change", () => {
      const { tiles, cameraDistance, cameraPan } = defaults;
      change({ shape: name, tiles, cameraDistance, cameraPan });
      showSettings();
    });
    $("shapes").append(label);
  }
}

// The slider sets the size of the pattern in powers of two, relative to the size for this shape.
function chooseTiles() {
  viewer.setShape(settings.shape);
  const factor = 2 ** -$("tiles").value, [u, v] = viewer.mesh.tiles;
  change({ tiles: [Math.max(1, Math.round(u * factor)), Math.max(1, Math.round(v * factor))] });
  showSettings();
}

function showSettings() {
  viewer.setShape(settings.shape);
  const tiles = settings.tiles || viewer.mesh.tiles;
  document.querySelector(`[name=shape][value=${settings.shape}]`).checked = true;
  $("exposure").value = settings.exposure;
  $("exposure-value").value = `${settings.exposure > 0 ? "+" : ""}${settings.exposure.toFixed(1)} EV`;
  $("ambient").value = settings.ambient;
  $("ambient-value").value = `${Math.round(100 * settings.ambient)} %`;
  if (!settings.tiles) $("tiles").value = 0;
  $("tiles-value").value = `${tiles[0]} × ${tiles[1]}`;
  $("silhouettes").checked = settings.silhouettes && Boolean(viewer.material.shell);
  $("silhouettes").disabled = !viewer.material.shell;
  $("alongSurface").checked = settings.alongSurface && settings.silhouettes && Boolean(viewer.material.along);
  $("alongSurface").disabled = !settings.silhouettes || !viewer.material.along;
  $("shadows").checked = settings.shadows;
}

function savePicture() {
  const image = viewer.picture({ ...viewer.fitted(settings, aspect()), supersample: 2 },
    canvas.width, canvas.height);
  const sheet = document.createElement("canvas"), link = document.createElement("a");
  Object.assign(sheet, { width: image.width, height: image.height });
  sheet.getContext("2d").putImageData(image, 0, 0);
  link.href = sheet.toDataURL("image/png");
  link.download = `${viewer.material.name}.png`;
  link.click();
}

function listenToControls() {
  for (const name of ["exposure", "ambient"])
    $(name).addEventListener("input", () => {
      change({ [name]: Number($(name).value) });
      showSettings();
    });
  $("tiles").addEventListener("input", chooseTiles);
  for (const name of ["silhouettes", "alongSurface", "shadows"])
    $(name).addEventListener("change", () => {
      change({ [name]: $(name).checked });
      showSettings();
    });
  $("reset").addEventListener("click", () => {
    settings = { ...first };
    showSettings();
    redraw();
  });
  $("save").addEventListener("click", savePicture);
  $("controls").addEventListener("submit", event => event.preventDefault());
  new ResizeObserver(redraw).observe(canvas);
}

function listenToTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const set = on => document.documentElement.classList.toggle("dark", on);
  set(dark.matches);
  dark.addEventListener("change", event => set(event.matches));
  $("theme").addEventListener("click", () => document.documentElement.classList.toggle("dark"));
}

function fail(error) {
  $("loading").hidden = false;
  $("bar").hidden = true;
  $("step").setAttribute("role", "alert");
  $("step").textContent = error.message;
  $("controls").hidden = $("drag").hidden = true;
}

// Returns a picture with these settings as the data URL of a PNG, for scripts that control the
// page.
function pictureUrl(wanted, width, height) {
  const sheet = document.createElement("canvas");
  Object.assign(sheet, { width, height });
  sheet.getContext("2d").putImageData(viewer.picture({ ...defaults, ...wanted }, width, height), 0, 0);
  return sheet.toDataURL("image/png");
}

async function start() {
  listenToTheme();
  $("name").textContent = document.title;
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
  if (!gl) throw new Error("This browser has no WebGL 2, or WebGL is switched off; switch it on, or use another browser.");
  if (received.bytes.length === 0 || received.at !== received.bytes.length)
    throw new Error("The page is incomplete; copy or download it again.");
  const material = await readMaterial(received.bytes, share => { $("bar").value = 0.5 + 0.4 * share; });
  received.bytes = null;
  $("step").textContent = "Preparing the picture";
  await new Promise(resolve => setTimeout(resolve)); // lets the browser show the progress first
  viewer = new Viewer(gl, material);
  material.data = null;
  const [[w, h]] = material.levels, mm = material.texel_mm;
  $("facts").textContent = `${w} × ${h} texels, ${(w * mm).toFixed(1)} × ${(h * mm).toFixed(1)} mm`;
  first = fromAddress(material.views);
  settings = { ...first };
  addShapes();
  $("controls").hidden = $("drag").hidden = false;
  showSettings();
  listenToCanvas();
  listenToControls();
  drawNow(1, 1);
  $("loading").hidden = true;
  redraw();
  window.mesorig = { pictureUrl, settings: () => ({ ...settings }) };
}

window.programBegan = true;
start().catch(fail);
