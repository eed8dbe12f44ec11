// The material so far (/api/v1/material): a picture of the sample that can be relit and turned while it is captured.
// Measured and predicted pictures come from the server, one for each pair of a view and a light. WebGL mixes those of
// the directions around the wanted view and light. app.js calls the functions at the end.
"use strict";

const material = {
  info: null,           // the last answer of /api/v1/material
  loading: null,        // promise of the request that is under way
  stale: true,          // whether info.pairs is older than the last forecast
  view: [20, -90], light: [35, 45], // θ and φ in degrees
  tinted: false,
  gl: null,
};

const layerCount = 48;   // pictures on the graphics card
const mixed = 9;         // pictures that are mixed: three views × three lights
const requestsAtOnce = 4;
const errorFull = 0.3;   // expected error that has the full tint

function unitVector([theta, phi]) {
  const t = theta * Math.PI / 180, p = phi * Math.PI / 180;
  return [Math.sin(t) * Math.cos(p), Math.sin(t) * Math.sin(p), Math.cos(t)];
}

function dot3(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

function cross3(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

// Returns up to three indices and weights of measured directions for a direction: the corners of the triangle that
// contains it. Outside of all triangles, the nearest point of a triangle counts. Without triangles, the nearest
// direction counts.
function around(direction, vectors, triangles) {
  let best = null, bestLeast = -Infinity;
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [triangles[t], triangles[t + 1], triangles[t + 2]];
    const [a, b, c] = corners.map(i => vectors[i]);
    const volume = dot3(a, cross3(b, c));
    if (Math.abs(volume) < 1e-9) continue;
    const weights = [dot3(direction, cross3(b, c)) / volume, dot3(direction, cross3(c, a)) / volume,
                     dot3(direction, cross3(a, b)) / volume];
    const least = Math.min(...weights);
    if (least > bestLeast && Math.max(...weights) > 0) {
      bestLeast = least;
      best = { corners, weights };
    }
  }
  if (!best) {
    let nearest = 0;
    vectors.forEach((v, i) => { if (dot3(v, direction) > dot3(vectors[nearest], direction)) nearest = i; });
    return [[nearest, 1]];
  }
  const weights = best.weights.map(w => Math.max(w, 0)), sum = weights.reduce((a, b) => a + b, 0);
  return best.corners.map((corner, i) => [corner, weights[i] / sum]).filter(([, w]) => w > 1e-4);
}

// Returns the pairs that are mixed for the current view and light, with their weights. A light below all measured ones
// darkens the picture by the cosine.
function wantedPairs() {
  const info = material.info, l = unitVector(material.light);
  const views = around(unitVector(material.view), info.viewVectors, info.view_triangles);
  const lights = around(l, info.lightVectors, info.light_triangles);
  const z = lights.reduce((sum, [i, w]) => sum + w * info.lightVectors[i][2], 0);
  const fade = z > 0 ? Math.min(1, Math.max(0, l[2]) / z) : 0;
  const n = info.lights.length, ret = [];
  for (const [v, wv] of views) for (const [i, wl] of lights) ret.push([v * n + i, wv * wl, wv * wl * fade]);
  return ret;
}

// --- drawing

const materialVertex = `#version 300 es
uniform mat2 place; uniform vec2 size; out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  at = vec2(corner.x, 1.0 - corner.y);
  gl_Position = vec4(place * ((corner - 0.5) * size), 0.0, 1.0);
}`;

const materialFragment = `#version 300 es
precision highp float; precision highp sampler2DArray;
uniform sampler2DArray pictures; uniform int layers[${mixed}]; uniform float weights[${mixed}];
uniform float exposure, tint; in vec2 at; out vec4 colour;
float srgb(float x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055; }
void main() {
  vec3 sum = vec3(0.0);
  for (int i = 0; i < ${mixed}; i++)
    if (weights[i] > 0.0) sum += weights[i] * texture(pictures, vec3(at, float(layers[i]))).rgb;
  sum = clamp(sum * exposure, 0.0, 1.0);
  sum = vec3(srgb(sum.r), srgb(sum.g), srgb(sum.b));
  if (tint >= 0.0) {
    float grey = dot(sum, vec3(0.2126, 0.7152, 0.0722));
    sum = mix(vec3(grey), mix(vec3(0.2, 0.5, 1.0), vec3(1.0, 0.25, 0.1), tint) * (0.25 + 0.75 * grey), 0.75);
  }
  colour = vec4(sum, 1.0);
}`;

function compile(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, materialVertex], [gl.FRAGMENT_SHADER, materialFragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  return program;
}

// Makes the texture for the pictures of a session.
function beginPictures() {
  const { info } = material;
  if (!material.gl) {
    material.gl = $("material").getContext("webgl2", { preserveDrawingBuffer: true });
    if (!material.gl) return;
    const program = compile(material.gl);
    material.at = name => material.gl.getUniformLocation(program, name);
  }
  const gl = material.gl;
  if (material.texture) gl.deleteTexture(material.texture);
  material.texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, material.texture);
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB9_E5, info.width, info.height, layerCount);
  for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
                              [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, key, value);
  material.layers = new Map(); // pair → { layer, version, used }
  material.requested = new Set();
  material.clock = 0;
}

// A picture on the card is as good as the server's if it was measured, or predicted by the last forecast.
function version(pair) {
  return material.info.pairs[pair] === 0 ? "measured" : `forecast ${material.info.forecast}`;
}

function freeLayer() {
  if (material.layers.size < layerCount) return material.layers.size;
  let oldest = null;
  for (const [pair, at] of material.layers)
    if (!oldest || at.used < material.layers.get(oldest).used) oldest = pair;
  const { layer } = material.layers.get(oldest);
  material.layers.delete(oldest);
  return layer;
}

async function loadPair(pair) {
  const session = material.info.session, wanted = version(pair);
  material.requested.add(pair);
  const answer = await fetch(`${api}material/${pair}`).catch(() => null);
  const texels = answer && answer.ok ? new Uint32Array(await answer.arrayBuffer()) : null;
  material.requested.delete(pair);
  if (!texels || session !== material.info.session) return;
  const gl = material.gl, known = material.layers.get(pair), layer = known ? known.layer : freeLayer();
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, material.texture);
  gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, material.info.width, material.info.height, 1, gl.RGB,
                   gl.UNSIGNED_INT_5_9_9_9_REV, texels);
  material.layers.set(pair, { layer, version: wanted, used: ++material.clock });
  material.shownAt = performance.timeOrigin + performance.now();
  drawMaterial();
}

// Draws the pictures that are on the card, and requests the missing and the outdated ones, the heaviest first.
function drawMaterial() {
  const { gl, info } = material;
  if (!gl || !info) return;
  const pairs = wantedPairs(), shown = [];
  for (const [pair, weight, light] of [...pairs].sort((a, b) => b[1] - a[1])) {
    const at = material.layers.get(pair);
    if (at) {
      at.used = ++material.clock;
      shown.push([at.layer, light, weight]);
    }
    const available = info.pairs[pair] >= 0;
    if (available && (!at || at.version !== version(pair)) && !material.requested.has(pair) &&
        material.requested.size < requestsAtOnce)
      loadPair(pair);
  }
  const sum = shown.reduce((total, [, , weight]) => total + weight, 0);
  const layers = new Int32Array(mixed), weights = new Float32Array(mixed);
  shown.slice(0, mixed).forEach(([layer, weight], i) => { layers[i] = layer; weights[i] = weight / sum; });
  const v = unitVector(material.view), phi = material.view[1] * Math.PI / 180;
  const right = [-Math.sin(phi), Math.cos(phi), 0], up = cross3(v, right);
  const canvas = $("material"), reach = Math.hypot(info.width_mm, info.height_mm) / 2;
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.uniformMatrix2fv(material.at("place"), false,
                      [right[0] / reach, up[0] / reach, right[1] / reach, up[1] / reach]);
  gl.uniform2f(material.at("size"), info.width_mm, info.height_mm);
  gl.uniform1iv(material.at("layers"), layers);
  gl.uniform1fv(material.at("weights"), weights);
  gl.uniform1f(material.at("exposure"), 2 ** Number($("material-exposure").value));
  const error = pairs.reduce((total, [pair, weight]) => total + weight * Math.max(info.pairs[pair], 0) / 1000, 0);
  const measured = pairs.filter(([pair]) => info.pairs[pair] === 0).length;
  gl.uniform1f(material.at("tint"), material.tinted ? Math.min(error / errorFull, 1) : -1);
  if (sum > 0) gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  drawLights();
  const angles = ([theta, azimuth]) => `θ ${Math.round(theta)}°, φ ${Math.round((azimuth % 360 + 360) % 360)}°`;
  text("material-text", `Light from ${angles(material.light)}, seen from ${angles(material.view)}: ` +
    (sum === 0 ? "no picture yet." : measured === pairs.length ? "measured."
      : `${measured ? "partly " : ""}predicted, expected error ${(100 * error).toFixed(1)} %.`));
}

// Draws the lights of the nearest view from above: measured ones are blue discs, predicted ones are coloured by their
// expected error, from green to red. A ring is the current light.
function drawLights() {
  const { info } = material, map = $("material-lights");
  const view = around(unitVector(material.view), info.viewVectors, info.view_triangles)
    .reduce((a, b) => b[1] > a[1] ? b : a)[0];
  const shapes = [svg("circle", { r: 96, class: "horizon" })];
  info.lightVectors.forEach(([x, y], i) => {
    const error = info.pairs[view * info.lights.length + i];
    const dot = svg("circle", { cx: 96 * x, cy: -96 * y, r: 4, class: error === 0 ? "measured" : "predicted" });
    dot.setAttribute("fill", error > 0 ? `hsl(${120 * (1 - Math.min(error / 1000 / errorFull, 1))} 70% 45%)` : "none");
    shapes.push(dot);
  });
  const [x, y] = unitVector(material.light);
  shapes.push(svg("circle", { cx: 96 * x, cy: -96 * y, r: 8, class: "current" }));
  map.replaceChildren(...shapes);
}

// --- the line about the error

// Returns the expected time in seconds until the error falls below a share, from the points of the forecast and the
// time left, or null if it does not. Shots that are not chosen yet are assumed to take as long as the chosen ones.
function timeUntil(share) {
  const later = material.later || [], left = state.shots - state.shots_done;
  if (!(left > 0) || !(state.left_s > 0)) return null;
  let [before, beforeError] = [0, material.error];
  for (const [shots, error] of later) {
    if (error <= share) {
      const part = (beforeError - share) / Math.max(beforeError - error, 1e-9);
      return (before + part * (shots - before)) / left * state.left_s;
    }
    [before, beforeError] = [shots, error];
  }
  return null;
}

function percent(share) {
  return `${100 * share >= 9.95 ? Math.round(100 * share) : (100 * share).toFixed(1)} %`;
}

function showError() {
  const { info, error } = material;
  if (!info) return;
  let line = `${info.measured} of ${info.pairs.length} pictures are measured. `;
  if (info.measured === info.pairs.length) line = `All ${info.measured} pictures are measured.`;
  else if (error === null) line += "The expected error is not known yet.";
  else {
    line += `Expected error ${percent(error)}`;
    const goal = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005].find(share => share < 0.8 * error && timeUntil(share) !== null);
    const runs = ["running", "homing"].includes(state.state);
    if (runs && goal) line += `, ${100 * goal} % in about ${aboutTime(timeUntil(goal))}`;
    line += ".";
  }
  text("material-error", line);
}

function aboutTime(seconds) {
  return seconds < 90 ? `${Math.max(5, 5 * Math.round(seconds / 5))} s`
    : seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

// --- news

async function reloadMaterial() {
  if (material.loading) return;
  material.stale = false;
  material.loading = fetch(`${api}material`).then(answer => answer.ok ? answer.json() : null).catch(() => null);
  const info = await material.loading;
  material.loading = null;
  $("material-section").hidden = !info;
  if (!info) { material.info = null; return; }
  const other = !material.info || material.info.session !== info.session ||
    material.info.pairs.length !== info.pairs.length || material.info.width !== info.width;
  info.viewVectors = info.views.map(unitVector);
  info.lightVectors = info.lights.map(unitVector);
  material.info = info;
  material.error = info.expected_error;
  material.later = info.later;
  text("material-problem", info.problem);
  if (other) beginPictures();
  $("material-no-webgl").hidden = !!material.gl;
  showError();
  drawMaterial();
  if (material.stale) reloadMaterial();
}

// Takes the event "material". A new forecast changes the errors of all pairs, which are loaded again.
function takeMaterial(event) {
  const { info } = material;
  material.error = event.expected_error;
  material.later = event.later;
  if (!info || info.session !== event.session || info.forecast !== event.forecast) {
    material.stale = true;
    reloadMaterial();
  }
  if (!info || info.session !== event.session) return;
  info.measured = event.measured;
  for (const pair of event.new) {
    info.pairs[pair] = 0;
    const at = material.layers && material.layers.get(pair);
    if (at) at.version = "";
  }
  showError();
  if (event.new.length) drawMaterial();
  stopAtGoal();
}

// --- controls

function turn(what, dTheta, dPhi) {
  const [theta, phi] = material[what];
  material[what] = [Math.min(85, Math.max(0, theta + dTheta)), (phi + dPhi + 360) % 360];
  drawMaterial();
}

// Moves the light to a point of the picture or of the map of lights, which is seen as a hemisphere from above.
function lightAt(element, event) {
  const box = element.getBoundingClientRect();
  const x = 2 * (event.clientX - box.left) / box.width - 1, y = 1 - 2 * (event.clientY - box.top) / box.height;
  const r = Math.min(Math.hypot(x, y), 0.996);
  material.light = [Math.asin(r) * 180 / Math.PI, (Math.atan2(y, x) * 180 / Math.PI + 360) % 360];
  drawMaterial();
}

for (const id of ["material", "material-lights"]) {
  const area = $(id);
  const turnsView = event => id === "material" && (event.shiftKey || $("material-drag").value === "view");
  area.addEventListener("pointerdown", event => {
    area.setPointerCapture(event.pointerId);
    if (!turnsView(event)) lightAt(area, event);
  });
  area.addEventListener("pointermove", event => {
    if (!area.hasPointerCapture(event.pointerId)) return;
    if (turnsView(event)) turn("view", -event.movementY / 3, event.movementX / 2);
    else lightAt(area, event);
  });
}

$("material").addEventListener("keydown", event => {
  const step = { ArrowUp: [5, 0], ArrowDown: [-5, 0], ArrowLeft: [0, 10], ArrowRight: [0, -10] }[event.key];
  if (!step) return;
  event.preventDefault();
  turn(event.shiftKey || $("material-drag").value === "view" ? "view" : "light", ...step);
});
$("material-tint").onchange = () => { material.tinted = $("material-tint").checked; drawMaterial(); };
$("material-exposure").oninput = drawMaterial;

// Ends the capture when the expected error has reached the number of the page. The page must stay open.
function stopAtGoal() {
  const goal = Number($("good-enough-pct").value);
  if (!(goal > 0) || material.error === null || 100 * material.error > goal || material.stopped ||
      !["running", "homing"].includes(state.state) || $("finish").disabled) return;
  material.stopped = true;
  act("finish");
}
$("good-enough-pct").oninput = () => { material.stopped = false; };
