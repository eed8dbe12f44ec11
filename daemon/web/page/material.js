// The material so far (/api/v1/material): a picture of the sample that can be relit and turned while it is captured.
// Measured and predicted pictures come from the server, one for each pair of a view and a light. WebGL mixes those of
// the directions around the wanted view and light. app.js calls the functions at the end.
"use strict";

const material = {
  info: null,           // the last answer of /api/v1/material
  loading: null,        // promise of the request that is under way
  stale: true,          // whether info.pairs is older than the last forecast
  view: [20, -90], light: [35, 45], // θ and φ in degrees
  turns: true,          // whether the sample can be turned: whether there are several views
  tinted: false,
  gl: null,
  frame: 0,             // the request for the next frame; 0 if the picture is up to date
};

const layerCount = 96;   // pictures on the graphics card
// Maximum number of pictures that are mixed: four views × four lights. Near the normal, all views or lights of the
// topmost ring count.
const mixed = 64;
const requestsAtOnce = 4;
const white = 0.8;       // value of a white diffuser at a brightness of 0 stops, as in mesorig-view
const errorFull = 0.3;   // expected error that has the full tint

function unitVector([theta, phi]) {
  const t = theta * Math.PI / 180, p = phi * Math.PI / 180;
  return [Math.sin(t) * Math.cos(p), Math.sin(t) * Math.sin(p), Math.cos(t)];
}

function dot3(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

function cross3(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

// --- interpolation between directions, as in mesorig-view (processing/directions/directions.h)

// Returns [before, after, share of after, θ] of a ring at an azimuth. A ring is a list of {index, theta, phi}.
function onRing(ring, phi) {
  let k = ring.findLastIndex(entry => entry.phi <= phi);
  if (k < 0) k = ring.length - 1;
  const a = ring[k], b = ring[(k + 1) % ring.length];
  const gap = k + 1 < ring.length ? b.phi - a.phi : b.phi + 360 - a.phi;
  const share = (phi >= a.phi ? phi - a.phi : phi - a.phi + 360) / gap;
  return [a.index, b.index, share, a.theta + share * (b.theta - a.theta)];
}

// Bilinear in θ and φ. Above the topmost ring the value goes towards the mean of that ring, which stands for the pole.
function aroundRings([theta, phi], rings) {
  const pair = ([a, b, share], weight) => [[a, weight * (1 - share)], [b, weight * share]];
  const hasPole = rings[0].length === 1;
  let above = hasPole ? [rings[0][0].index, rings[0][0].index, 0, rings[0][0].theta] : null;
  for (const ring of hasPole ? rings.slice(1) : rings) {
    const below = onRing(ring, phi), from = above ? above[3] : 0;
    if (theta < below[3]) {
      const t = theta <= from ? 0 : (theta - from) / (below[3] - from);
      const upper = above ? pair(above, 1 - t) : ring.map(({ index }) => [index, (1 - t) / ring.length]);
      return { shares: [...upper, ...pair(below, t)], end: below[3] };
    }
    above = below;
  }
  return { shares: pair(above, 1), end: above[3] };
}

// Returns the nearest point of a triangle in the plane as weights of its corners, and its distance.
function onTriangle(at, corners) {
  const [a, b, c] = corners, area = (p, q, r) => (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
  const whole = area(a, b, c), weights = [area(at, b, c), area(a, at, c), area(a, b, at)].map(part => part / whole);
  if (weights.every(weight => weight >= 0)) return { weights, distance: 0 };
  let best = { distance: Infinity };
  for (let i = 0; i < 3; i++) {
    const p = corners[i], q = corners[(i + 1) % 3], d = [q[0] - p[0], q[1] - p[1]];
    const t = ((at[0] - p[0]) * d[0] + (at[1] - p[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1]);
    const share = Math.min(1, Math.max(0, t));
    const distance = Math.hypot(at[0] - p[0] - share * d[0], at[1] - p[1] - share * d[1]);
    if (distance >= best.distance) continue;
    best = { distance, weights: [0, 0, 0] };
    best.weights[i] = 1 - share;
    best.weights[(i + 1) % 3] = share;
  }
  return best;
}

function toPlane([theta, phi]) {
  const r = Math.tan(theta * Math.PI / 360), p = phi * Math.PI / 180;
  return [r * Math.cos(p), r * Math.sin(p)];
}

// Linear in the triangles of the stereographic plane. Outside of them the nearest point counts.
function aroundTriangles(direction, directions, triangles) {
  const at = toPlane(direction);
  let best = { distance: Infinity };
  for (let t = 0; t < triangles.length; t += 3) {
    const indices = triangles.slice(t, t + 3), corners = indices.map(i => toPlane(directions[i]));
    const here = onTriangle(at, corners);
    if (here.distance < best.distance) best = { ...here, indices, corners };
  }
  if (best.distance === Infinity) { // too few directions
    const vectors = directions.map(unitVector), v = unitVector(direction);
    const nearest = vectors.reduce((to, w, i) => dot3(w, v) > dot3(vectors[to], v) ? i : to, 0);
    return { shares: [[nearest, 1]], end: directions[nearest][0] };
  }
  const point = [0, 1].map(k => best.weights.reduce((sum, w, i) => sum + w * best.corners[i][k], 0));
  return { shares: best.indices.map((index, i) => [index, best.weights[i]]),
           end: best.distance > 0 ? 2 * Math.atan(Math.hypot(...point)) * 180 / Math.PI : 90 };
}

// Returns the measured directions around [θ, φ] with their weights, and the θ up to which they reach there.
function around([theta, phi], directions, rings, triangles) {
  const azimuth = angle => (angle % 360 + 360) % 360;
  const { shares, end } = rings.length === 0 ? aroundTriangles([theta, phi], directions, triangles)
    : aroundRings([theta, azimuth(phi)], rings.map(ring => ring.map(
      index => ({ index, theta: directions[index][0], phi: azimuth(directions[index][1]) }))));
  const sums = new Map();
  for (const [index, weight] of shares) sums.set(index, (sums.get(index) || 0) + weight);
  return { shares: [...sums].filter(([, weight]) => weight > 1e-4), end };
}

function viewsAround() {
  const { info } = material;
  return around(material.view, info.views, info.view_rings, info.view_triangles).shares;
}

// Returns the pairs that are mixed for the current view and light, with their weights. A light below all measured ones
// darkens the picture by the cosine.
function wantedPairs() {
  const { info } = material, cosine = theta => Math.cos(theta * Math.PI / 180);
  const { shares, end } = around(material.light, info.lights, info.light_rings, info.light_triangles);
  const fade = material.light[0] <= end ? 1 : Math.min(1, Math.max(0, cosine(material.light[0])) / cosine(end));
  const n = info.lights.length, ret = [];
  for (const [v, wv] of viewsAround()) for (const [i, wl] of shares) ret.push([v * n + i, wv * wl, wv * wl * fade]);
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
uniform sampler2DArray pictures; uniform vec4 mixes[${mixed / 2}]; // layer and weight of two pictures
uniform float exposure, tint; in vec2 at; out vec4 colour;
// As in mesorig-view (tone.glsl).
float tone(float x) { return x < 0.8 ? x : 1.0 - 0.2 * exp((0.8 - x) / 0.2); }
float srgb(float x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055; }
void main() {
  vec3 sum = vec3(0.0);
  for (int i = 0; i < ${mixed / 2}; i++) {
    if (mixes[i].y > 0.0) sum += mixes[i].y * texture(pictures, vec3(at, mixes[i].x)).rgb;
    if (mixes[i].w > 0.0) sum += mixes[i].w * texture(pictures, vec3(at, mixes[i].z)).rgb;
  }
  sum *= exposure;
  sum = vec3(srgb(tone(sum.r)), srgb(tone(sum.g)), srgb(tone(sum.b)));
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

// A dome has one view, from which the sample is always seen.
function beginView() {
  const { views } = material.info;
  material.turns = views.length > 1;
  if (!material.turns) material.view = views[0].slice();
  for (const id of ["material-drag-label", "material-help-view"]) $(id).hidden = !material.turns;
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

// Draws in the next frame of the browser, so that several pictures that arrive together are drawn once. A page that
// nobody sees has no frames, and requests no pictures.
function drawMaterial() {
  if (!material.frame) material.frame = requestAnimationFrame(drawFrame);
}

// Draws the pictures that are on the card, and requests the missing and the outdated ones, the heaviest first.
function drawFrame() {
  const { gl, info } = material;
  material.frame = 0;
  if (!gl || !info) return;
  const pairs = wantedPairs().sort((a, b) => b[1] - a[1]).slice(0, mixed), shown = [];
  for (const [pair, weight, light] of pairs) {
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
  const sum = shown.reduce((total, [, , weight]) => total + weight, 0), mixes = new Float32Array(2 * mixed);
  shown.forEach(([layer, weight], i) => { mixes[2 * i] = layer; mixes[2 * i + 1] = weight / sum; });
  const v = unitVector(material.view), phi = material.view[1] * Math.PI / 180;
  const right = [-Math.sin(phi), Math.cos(phi), 0], up = cross3(v, right);
  const canvas = $("material"), reach = Math.hypot(info.width_mm, info.height_mm) / 2;
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.uniformMatrix2fv(material.at("place"), false,
                      [right[0] / reach, up[0] / reach, right[1] / reach, up[1] / reach]);
  gl.uniform2f(material.at("size"), info.width_mm, info.height_mm);
  gl.uniform4fv(material.at("mixes"), mixes);
  gl.uniform1f(material.at("exposure"), white * 2 ** Number($("material-exposure").value));
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
  const view = viewsAround().reduce((a, b) => b[1] > a[1] ? b : a)[0];
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

// Returns whether there are lights below all those under which a picture was measured. Nothing tells then how long
// shadows become.
function lacksLowLights() {
  const { lights, pairs } = material.info, known = new Set();
  pairs.forEach((error, pair) => { if (error === 0) known.add(pair % lights.length); });
  const lowest = thetas => Math.max(...thetas);
  return lowest(lights.map(([theta]) => theta)) > lowest([...known].map(i => lights[i][0])) + 2.5;
}

function showError() {
  const { info, error } = material;
  if (!info) return;
  let line = `${info.measured} of ${info.pairs.length} pictures are measured. `;
  if (info.measured === info.pairs.length) line = `All ${info.measured} pictures are measured.`;
  else if (error === null) line += "The expected error is not known yet.";
  else {
    const [low, high] = material.range.map(percent);
    line += `Expected error ${percent(error)}${low === high ? "" : ` (${low} to ${high})`}`;
    const goal = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005].find(share => share < 0.8 * error && timeUntil(share) !== null);
    const runs = ["running", "homing"].includes(state.state);
    if (runs && goal) line += `, ${100 * goal} % in about ${aboutTime(timeUntil(goal))}`;
    line += ".";
    if (lacksLowLights()) line += " Low lights are missing, so the error may be several times as large.";
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
  info.lightVectors = info.lights.map(unitVector);
  material.info = info;
  material.error = info.expected_error;
  material.range = info.expected_error_range;
  material.later = info.later;
  text("material-problem", info.problem);
  if (other) {
    beginPictures();
    beginView();
  }
  $("material-no-webgl").hidden = !!material.gl;
  showError();
  drawMaterial();
  if (material.stale) reloadMaterial();
}

// Takes the event "material". A new forecast changes the errors of all pairs, which are loaded again.
function takeMaterial(event) {
  const { info } = material;
  material.error = event.expected_error;
  material.range = event.expected_error_range;
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
  if (what === "view" && !material.turns) return;
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
  const turnsView = event => id === "material" && material.turns &&
    (event.shiftKey || $("material-drag").value === "view");
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
  turn(event.shiftKey || (material.turns && $("material-drag").value === "view") ? "view" : "light", ...step);
});
$("material-tint").onchange = () => { material.tinted = $("material-tint").checked; drawMaterial(); };
$("material-exposure").oninput = drawMaterial;

// Ends the capture when the expected error has reached the number of the page. The page must stay open. A session
// is ended once: after "finish" an operator may resume it. A refused "finish" is tried again with the next picture.
async function stopAtGoal() {
  const goal = Number($("good-enough-pct").value), { session } = material.info;
  if (!(goal > 0) || material.error === null || 100 * material.error > goal || material.stopped === session ||
      state.session !== session || !["running", "homing"].includes(state.state) || $("finish").disabled) return;
  material.stopped = session;
  if (!await act("finish")) material.stopped = null;
}
$("good-enough-pct").oninput = () => { material.stopped = null; };
