// The page of mesorig-web. It shows the state and the events that the stream /api/v1/events sends, and the
// pictures of the cameras. Its buttons send commands to the server.
"use strict";

const $ = id => document.getElementById(id);
const api = "/api/v1/";
const pictureInterval = 2000; // minimum time in ms between two requests for a picture of a camera
const clockTime = { hour: "2-digit", minute: "2-digit", hourCycle: "h23" };
let state = {};
let acts = true; // whether the server accepts commands, because it has a token
let safeNeedsToken = false;

function text(id, value) {
  if ($(id).textContent !== String(value)) $(id).textContent = value;
}

function element(name, className, content) {
  const ret = document.createElement(name);
  if (className) ret.className = className;
  if (content !== undefined) ret.textContent = content;
  return ret;
}

function svg(name, attributes) {
  const ret = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in attributes) ret.setAttribute(key, attributes[key]);
  return ret;
}

function duration(seconds) {
  if (!(seconds >= 0)) return "–";
  const s = Math.round(seconds), h = Math.floor(s / 3600), m = Math.floor(s / 60) % 60;
  return h ? `${h} h ${String(m).padStart(2, "0")} min`
           : m ? `${m} min ${String(s % 60).padStart(2, "0")} s` : `${s} s`;
}

// Returns the time left as text. While a capture runs, it is computed from the predicted end and the browser's
// clock, because the clock of a simulated rig runs at a different speed.
function timeLeft(runs, paused) {
  if (runs && state.predicted_end) return duration(Math.max(0, state.predicted_end - Date.now() / 1000));
  if (paused && state.left_s > 0)
    return `${duration(state.left_s)}${state.simulated ? " (simulated)" : ""} after it continues`;
  return "–";
}

function showState() {
  const away = state.state === "away", runs = ["running", "homing"].includes(state.state);
  const paused = state.state === "paused", busy = runs || paused || state.state === "pausing";
  text("state", away ? "mesorigd does not answer" : state.state);
  $("state").className = `badge ${state.state}`;
  document.title = busy && state.shots
    ? `${Math.floor(100 * state.shots_done / state.shots)} % ${state.state}` : `Mesorig: ${state.state}`;
  text("session", state.session || state.rig || "no rig is open");
  text("doing", state.doing || "");
  showUnsafe(away);
  showLatched();
  showNotice(paused);
  showPose();
  $("bar").value = state.shots ? state.shots_done / state.shots : 0;
  text("shots", state.shots ? `${state.shots_done} of ${state.shots}` : "–");
  text("left", timeLeft(runs, paused));
  text("end", runs && state.predicted_end
    ? new Date(1000 * state.predicted_end).toLocaleTimeString([], clockTime)
    : "–");
  text("elapsed", state.elapsed_s ? duration(state.elapsed_s) + (state.simulated ? " (simulated)" : "") : "–");
  text("frames", state.frames ?? "–");
  text("retakes", state.retakes ?? "–");
  text("version", state.version || "");
  const token = sessionStorage.getItem("token");
  $("pause").disabled = !token || !runs;
  $("continue").disabled = !token || (!paused && !state.prompt);
  $("abort").disabled = !token || !busy;
  $("finish").disabled = !token || !busy;
  $("good-enough").hidden = !acts || !token || !busy || !material.info;
  $("release").hidden = !state.latched;
  $("release").disabled = !token || away;
  $("unlock").hidden = !acts || !!token;
  for (const name of ["pause", "continue", "finish", "abort"]) $(name).hidden = !acts;
  if (!acts) $("release").hidden = true;
  const rows = (state.devices || []).map(device => {
    const row = element("tr", device.health.startsWith("unsafe") ? "unsafe" : "");
    for (const key of ["class", "name", "driver", "health"]) row.append(element("td", "", device[key]));
    return row;
  });
  $("devices").tBodies[0].replaceChildren(...rows);
  showQueue();
  showError();
  for (const device of state.devices || [])
    if (device.class === "camera") watchCamera(device.name);
  document.dispatchEvent(new Event("rig"));
}

// Shows the devices that have not confirmed that they are off or stand still. Shows none while no daemon answers,
// because nothing is known then.
function showUnsafe(away) {
  const names = away ? [] : state.unsafe || [];
  const lines = names.map(name => {
    const device = (state.devices || []).find(each => `${each.class} ${each.name}` === name);
    return device && device.health.startsWith("unsafe: ") ? `${name}: ${device.health.slice(8)}` : name;
  });
  $("unsafe").hidden = lines.length === 0;
  if (lines.length > 0) text("done", "");
  if ($("unsafe-devices").dataset.shown === lines.join("\n")) return;
  $("unsafe-devices").dataset.shown = lines.join("\n");
  $("unsafe-devices").replaceChildren(...lines.map(line => element("li", "", line)));
}

function showLatched() {
  $("latched").hidden = !state.latched || state.state === "away";
  text("latched-text", "Nothing shines or moves until the rig is released: " + (!acts ? "run mesorig release." : sessionStorage.getItem("token") ? "press Release." : "enter the token and press Release."));
}

// Shows why the capture has stopped and the steps to continue it. The daemon's reason says what to do about a
// faulty device.
function showNotice(paused) {
  const faulty = (state.devices || []).filter(device => device.health.startsWith("fault: "));
  const prompt = state.prompt || "", reason = prompt ? "" : state.reason || "";
  const aborted = state.state === "aborted";
  const fault = faulty.length > 0 && (paused || aborted);
  $("notice").hidden = !prompt && !reason;
  $("notice").className = fault || aborted ? "bad" : "";
  text("notice-head", prompt ? "To do at the rig" : fault ? `Fault: ${faulty.map(device => device.name).join(", ")}`
    : aborted ? "Aborted" : "Paused");
  text("reason", reason);
  text("prompt", prompt);
  const resume = state.session ? `mesorig resume ${state.session}` : "mesorig resume DIR";
  const steps = [];
  const goOn = acts ? "Press Continue" : "Run: mesorig continue", makeSafe = acts ? "press Safe state" : "run mesorig safe";
  if (prompt) steps.push("Do this.", `${goOn}.`);
  else if (paused) {
    if (fault) steps.push(`Lamps and lasers were told to switch off, and the axes to stop. Before you reach into the rig, ${makeSafe}. It says whether each device has confirmed this.`,
                          `Repair ${faulty.map(device => device.name).join(", ")} as the message says.`);
    steps.push(fault ? `${goOn}. The interrupted shot is taken again. No frame is lost.`
                     : `${goOn}.`);
  } else if (aborted) steps.push(`The frames are kept. To continue: ${resume}`);
  const wanted = reason || prompt ? steps : [];
  if ($("steps").dataset.shown !== wanted.join("\n")) {
    $("steps").dataset.shown = wanted.join("\n");
    $("steps").replaceChildren(...wanted.map(step => element("li", "", step)));
  }
}

// --- pose: a drawing of the rig from above, with x to the right. A device at polar angle θ is
// drawn at sin θ times the radius of the circle of the horizon, so the zenith is in the middle.

const horizon = 92; // radius of the circle of the horizon in units of the drawing

function place(theta, phi) {
  const r = horizon * Math.sin(theta * Math.PI / 180), a = phi * Math.PI / 180;
  return [r * Math.cos(a), -r * Math.sin(a)];
}

function degrees(value) {
  return `${Math.round(10 * (((value % 360) + 360) % 360)) / 10 % 360}°`;
}

// Returns whether a lamp or laser is known to shine. While shots are taken, only the light of the last shot is
// shown as shining. At other times, the health of a laser says whether the laser may shine. For a lamp this is not
// known, because the health of a bank of lamps contains only the number of lamps that are on.
function shines(at) {
  if (["running", "homing", "pausing"].includes(state.state))
    return at.class === state.light_class && at.name === state.light;
  if (state.state === "away" || at.class !== "laser") return false;
  const device = (state.devices || []).find(each => each.class === at.class && each.name === at.name);
  return !!device && /^(on|unsafe)/.test(device.health);
}

function isUnsafe(at) {
  return (state.unsafe || []).includes(`${at.class} ${at.name}`);
}

function showPose() {
  const places = state.places || [];
  $("pose-section").hidden = places.length === 0;
  if (places.length === 0) return;
  const turn = state.turntable_deg || 0, arc = state.arc_deg || 0;
  const on = places.filter(shines);
  const key = JSON.stringify([places, turn, arc, state.light_class, state.light, on, state.unsafe]);
  if ($("pose").dataset.shown === key) return;
  $("pose").dataset.shown = key;
  const shapes = [svg("circle", { r: horizon, class: "horizon" })];
  if (places.some(at => at.carried)) {
    const [x, y] = place(90, arc);
    shapes.push(svg("line", { x1: -x, y1: -y, x2: x, y2: y, class: "arc" }));
  }
  const table = svg("g", { transform: `rotate(${-turn})` });
  table.append(svg("circle", { r: 34, class: "table" }), svg("rect", { x: -20, y: -20, width: 40, height: 40, class: "sample" }),
               svg("line", { x1: 20, y1: 0, x2: 34, y2: 0, class: "zero" }));
  shapes.push(table);
  let last = null;
  for (const at of places) {
    const phi = at.phi_deg + (at.carried ? arc : 0), aside = at.class === "laser" ? 7 : 0; // draws a laser next to a lamp at the same place
    let [x, y] = place(at.theta_deg, phi);
    x -= aside * Math.sin(phi * Math.PI / 180);
    y -= aside * Math.cos(phi * Math.PI / 180);
    if (at.class === state.light_class && at.name === state.light)
      last = `${at.name} ${!on.includes(at) ? "lit the last shot" : isUnsafe(at) ? "may shine" : "shines"} from θ ` +
             `${degrees(at.theta_deg)}, φ ${degrees(phi - turn)} of the sample.`;
    if (on.includes(at)) shapes.push(svg("line", { x1: x, y1: y, x2: 0, y2: 0, class: `ray ${at.class}${isUnsafe(at) ? " unsafe" : ""}` }));
    const mark = at.class === "camera"
      ? svg("rect", { x: x - 4, y: y - 4, width: 8, height: 8, transform: `rotate(${-phi} ${x} ${y})` })
      : at.class === "laser" ? svg("path", { d: `M${x} ${y - 5}L${x + 4.5} ${y + 3}L${x - 4.5} ${y + 3}Z` })
                             : svg("circle", { cx: x, cy: y, r: 3.5 });
    mark.setAttribute("class", `${at.class}${on.includes(at) ? " on" : ""}`);
    const title = svg("title", {});
    title.textContent = `${at.name}: θ ${degrees(at.theta_deg)}, φ ${degrees(phi)}`;
    mark.append(title);
    shapes.push(mark);
  }
  $("pose").replaceChildren(...shapes);
  const others = on.filter(at => at.class !== state.light_class || at.name !== state.light);
  text("pose-text", `Seen from above: turntable ${degrees(turn)}, arc ${degrees(arc)}; ` +
    (last || (state.light_class === "dark" ? "dark frames." : "no shot yet.")) +
    others.map(at => ` ${at.name} ${isUnsafe(at) ? "may shine" : "shines"}.`).join("") + " Squares are cameras, discs lamps, triangles lasers.");
}

// --- queue

const queueStates = { empty: "The queue is empty.", waiting: "The queue waits for the rig.",
                      working: "A session is being captured.",
                      hands: "The queue waits for an operator at the rig.", paused: "The queue is paused." };

const itemStates = { begun: "is being captured", hands: "waits for an operator", trying: "takes test shots" };

function time(seconds) {
  return seconds ? new Date(1000 * seconds).toLocaleTimeString([], clockTime) : "–";
}

// Shows when each session of the queue has begun and ended, or is expected to. A session is expected to begin when
// the one before it ends, and to take as long as its plan predicts. Nothing is expected while the queue is paused.
function showQueue() {
  const keeps = state.queue_state && state.queue_state !== "none";
  $("queue-section").hidden = !keeps;
  if (!keeps) return;
  text("queue-state", [queueStates[state.queue_state], state.queue_reason].filter(Boolean).join(" "));
  const key = JSON.stringify([state.queue, state.queue_state, state.predicted_end, !sessionStorage.getItem("token")]);
  if ($("queue").dataset.shown === key) return; // so that a button in the list keeps the focus
  $("queue").dataset.shown = key;
  let at = state.queue_state === "paused" ? 0 : Date.now() / 1000;
  $("queue").replaceChildren(...state.queue.map(item => {
    const ended = ["done", "stopped"].includes(item.state), runs = item.state === "begun";
    let begin = item.begun_at, end = item.ended_at;
    if (!ended) {
      if (!runs) begin = at;
      at = end = runs && state.predicted_end ? state.predicted_end : at && at + item.predicted_s;
    }
    const row = element("li", item.state);
    row.value = item.number;
    row.append(element("strong", "", item.name), ` ${itemStates[item.state] || item.state}, ` +
      `${time(begin)} – ${time(end)}`);
    if (item.message) row.append(element("p", "faint", item.message));
    if (item.prompt && !ended && !runs) row.append(element("p", "faint", `Before this session: ${item.prompt}`));
    if (acts && !runs && item.state !== "trying") row.append(actButton("Remove", `Remove ${item.name} from the queue`, `queue/${item.number}/remove`));
    return row;
  }));
}

// --- cameras

const cameras = new Map();

// A rig may have many cameras. Only the pictures that are in sight, or nearly so, are loaded.
const sight = new IntersectionObserver(entries => {
  for (const entry of entries) {
    const camera = cameras.get(entry.target.dataset.camera);
    camera.inSight = entry.isIntersecting;
    if (camera.inSight && camera.isStale) loadPicture(entry.target.dataset.camera);
  }
}, { rootMargin: "100%" });

function watchCamera(name) {
  if (cameras.has(name)) return cameras.get(name);
  const camera = { figure: element("figure"), image: element("img"), caption: element("figcaption"),
                   histogram: svg("svg", { viewBox: "0 0 64 32", preserveAspectRatio: "none" }),
                   due: 0, waits: false, inSight: false, isStale: true };
  camera.image.alt = `latest picture of ${name}`;
  camera.figure.dataset.camera = name;
  camera.figure.append(camera.image, camera.histogram, camera.caption);
  camera.caption.append(element("strong", "", name), ": no picture yet");
  if (cameras.size === 0) $("cameras").replaceChildren();
  cameras.set(name, camera);
  $("cameras").append(camera.figure);
  sight.observe(camera.figure);
  return camera;
}

// Loads the latest picture of a camera, at most once in pictureInterval. Calls during the wait share the next load.
// The picture of a camera that is out of sight is loaded when the camera comes into sight.
async function loadPicture(name) {
  const camera = cameras.get(name), now = Date.now();
  camera.isStale = true;
  if (camera.waits || !camera.inSight) return;
  camera.waits = true;
  await new Promise(done => setTimeout(done, Math.max(0, camera.due - now)));
  camera.due = Date.now() + pictureInterval;
  camera.waits = false;
  camera.isStale = false;
  const answer = await fetch(`${api}cameras/${encodeURIComponent(name)}.json`).catch(() => null);
  if (!answer || !answer.ok) return;
  const told = await answer.json();
  camera.image.src = `${api}cameras/${encodeURIComponent(name)}.png?t=${told.time_s}`;
  const most = Math.max(1, ...told.histogram.flat());
  const colours = ["#d33", "#2a2", "#36f"];
  camera.histogram.replaceChildren(...told.histogram.map((steps, c) => svg("path", {
    d: "M0 32" + steps.map((n, i) => `L${i} ${32 - 31 * Math.sqrt(n / most)}`).join("") + "L63 32Z",
    fill: colours[c], "fill-opacity": 0.5 })));
  camera.caption.replaceChildren(element("strong", "", name),
    ` ${told.width} × ${told.height}, `,
    `brightened for this page, also in the histogram; ${acts ? "Live view" : "“mesorig snap”"} shows the camera's values`);
}

// --- course and events

function drawCourse(course) {
  const n = course.shots.length, plot = $("plot");
  if (n < 2) return;
  const t0 = course.elapsed_s[0], t1 = course.elapsed_s[n - 1], most = state.shots || course.shots[n - 1];
  const x = t => 40 + 550 * (t - t0) / Math.max(t1 - t0, 1e-3), y = s => 180 - 165 * s / Math.max(most, 1);
  const label = (px, py, value, anchor) => {
    const ret = svg("text", { x: px, y: py, "text-anchor": anchor });
    ret.textContent = value;
    return ret;
  };
  plot.replaceChildren(
    svg("path", { d: course.shots.map((s, i) => `${i ? "L" : "M"}${x(course.elapsed_s[i]).toFixed(1)} ${y(s).toFixed(1)}`).join("") }),
    label(36, 184, 0, "end"), label(36, 20, most, "end"),
    label(40, 197, duration(t0), "start"), label(590, 197, duration(t1), "end"));
}

function addEvent(event) {
  const time = new Date(1000 * event.time).toLocaleTimeString([], { ...clockTime, second: "2-digit" });
  const row = element("li", event.level, `${time} ${event.source}: ${event.message}`);
  $("events").prepend(row);
  while ($("events").children.length > 200) $("events").lastChild.remove();
}

// --- actions

// Sends a command. Returns whether it was accepted, and the answer of the server, which says why if it was not.
async function send(name) {
  const token = sessionStorage.getItem("token");
  const answer = await fetch(api + name, {
    method: "POST", headers: token ? { Authorization: `Bearer ${token}` } : {}
  }).catch(error => ({ ok: false, json: async () => ({ error: String(error) }) }));
  const told = await answer.json().catch(() => ({ error: "the answer of the server is not JSON" }));
  if (answer.status === 401) sessionStorage.removeItem("token");
  return { ok: answer.ok, told };
}

// Sends a command. Returns the answer of the server, or null if it was refused. The page then says why.
async function act(name) {
  text("answer", "");
  text("done", "");
  const { ok, told } = await send(name);
  if (ok && name === "safe") showSafe(told);
  if (ok) return told;
  text("answer", told.error);
  showState();
  return null;
}

// Returns a button with a command. label says in full what it does, for screen readers.
function actButton(name, label, path) {
  const button = element("button", "small", name);
  button.setAttribute("aria-label", label);
  button.disabled = !sessionStorage.getItem("token");
  button.onclick = () => act(path);
  return button;
}

// Shows the answer of SafeState, with the devices that were not read back. A device with the state "commanded only"
// may still answer; if it does not, it appears among the unsafe devices.
function showSafe(told) {
  const list = (told.devices || []).filter(device => ["commanded only", "NOT safe"].includes(device.state));
  const blind = (told.devices || []).filter(device => device.state.startsWith("sent"));
  const names = list.map(device => `${device.class} ${device.name}`).join(", ");
  if (told.safe && blind.length)
    text("done", "Every device is off or stands as far as can be known. Cannot be read back: " +
         blind.map(device => `${device.class} ${device.name}`).join(", "));
  else if (told.safe) text("done", "The rig is safe: every device was read back.");
  else if (list.every(device => device.state === "commanded only"))
    text("answer", `Not confirmed yet: ${names}. Press again to see whether they have confirmed.`);
  else text("answer", `NOT safe: ${names}. Switch them off by hand.`);
}

function askToken() {
  $("token-form").hidden = false;
  $("token").focus();
}

for (const name of ["pause", "continue", "release"]) $(name).onclick = () => act(name);
$("safe").onclick = () => safeNeedsToken && !sessionStorage.getItem("token") ? askToken() : act("safe");
// A dialog would hide the button “Safe state”. The buttons therefore ask to be pressed again.
const ends = {
  abort: ["Abort", "Press again to abort", "Frames that were taken are kept, and the session can be resumed."],
  finish: ["Good enough", "Press again to end",
           "Frames that were taken are kept. The other shots are left out, and their pictures are predicted."],
};
for (const name in ends) $(name).onclick = () => {
  if ($(name).dataset.sure) act(name);
  const sure = !$(name).dataset.sure;
  clearTimeout($(name).dataset.timer);
  showSure(name, sure);
  if (sure) $(name).dataset.timer = setTimeout(showSure, 5000, name, false);
};
function showSure(name, sure) {
  const [label, again, what] = ends[name];
  $(name).dataset.sure = sure ? "1" : "";
  text(name, sure ? again : label);
  text("done", sure ? what : "");
}
$("unlock").onclick = askToken;
$("token-form").onsubmit = event => {
  event.preventDefault();
  sessionStorage.setItem("token", $("token").value.trim());
  $("token").value = "";
  $("token-form").hidden = true;
  showState();
};

// --- the stream

async function getJson(name) {
  return (await fetch(api + name)).json();
}

async function reload() {
  const access = await getJson("access");
  acts = access.acts;
  safeNeedsToken = access.safe_needs_token;
  showState();
  $("events").replaceChildren();
  for (const event of await getJson("log")) addEvent(event);
  drawCourse(await getJson("progress"));
  await reloadMaterial();
}

let course = 0;
function away() {
  state = { ...state, state: "away" };
  showState();
}

// Opens the stream of events. A browser does not repeat a request for a stream that was refused, for instance because
// too many streams are open. This function repeats such a request after 5 s.
function openStream() {
  const stream = new EventSource(api + "events");
  stream.onopen = () => reload().catch(() => {});
  stream.onerror = () => {
    away();
    if (stream.readyState === EventSource.CLOSED) setTimeout(openStream, 5000);
  };
  stream.addEventListener("event", event => addEvent(JSON.parse(event.data)));
  stream.addEventListener("material", event => takeMaterial(JSON.parse(event.data)));
  stream.addEventListener("picture", event => {
    const { camera } = JSON.parse(event.data);
    if (cameras.has(camera)) loadPicture(camera); else watchCamera(camera);
  });
  stream.addEventListener("state", event => {
    const told = JSON.parse(event.data);
    if (told.state !== "away") told.places ??= state.places; // they are sent only after a change
    state = told;
    showState();
    if (Date.now() > course + 5000) {
      course = Date.now();
      getJson("progress").then(drawCourse).catch(() => {});
    }
  });
}
addEventListener("load", openStream); // material.js is loaded after this file
