// The session files and session directories of the folder of --sessions: plan, start, queue, resume.
"use strict";

let planned = ""; // file and name of the last plan without a mistake; Start and Add to queue need it
let hasFolder = false;
let sessionsShown = "";
let sessionList = []; // of the folder: name, changed
let fileList = [];

// Returns the path of a command for the chosen file, with its query.
function filePath(what, query) {
  return `files/${encodeURIComponent($("file").value)}/${what}?${new URLSearchParams(query)}`;
}

function chosen() {
  return JSON.stringify([$("file").value, $("session-name").value, $("calibration").value]);
}

// Enables the buttons that are of use now.
function showCapture() {
  const token = !!sessionStorage.getItem("token"), away = state.state === "away";
  const isFree = ["idle", "done", "aborted"].includes(state.state);
  const keeps = !!state.queue_state && state.queue_state !== "none";
  const hasPlan = planned === chosen();
  $("capture-section").hidden = !hasFolder || !acts;
  $("sessions-section").hidden = !hasFolder;
  $("plan").disabled = !token || away || !$("file").value;
  $("start").disabled = !token || !isFree || state.latched || !hasPlan || ["working", "hands"].includes(state.queue_state);
  $("enqueue").hidden = !keeps;
  $("enqueue").disabled = !token || away || !hasPlan;
  $("queue-buttons").hidden = !acts || !keeps;
  $("queue-pause").disabled = !token || state.queue_state === "paused";
  $("queue-resume").disabled = !token || state.queue_state !== "paused";
  text("capture-hint", !$("file").value ? "The folder has no session file."
    : !token ? "Enter the token to plan and capture."
    : state.state === "closed" ? "No rig is open. Start mesorigd with --rig RIG."
    : state.latched ? "The rig is held in the safe state. Release it to capture."
    : !hasPlan ? "Plan first: it says how long the capture takes, and how much space it needs."
    : keeps ? "Start begins at once, without test shots. The queue first takes test shots, and chooses exposures that are auto."
    : "Start begins at once, without test shots.");
  for (const button of document.querySelectorAll("#sessions .resume"))
    button.disabled = !token || !isFree || state.latched;
  showProducts();
}

// Returns what a request says about the session: its name, and the calibration unless it is that of the rig file.
function sessionQuery(more) {
  const calibration = $("calibration").value;
  return { session: $("session-name").value, ...(calibration && { calibration }), ...more };
}

function size(bytes) {
  const units = ["bytes", "kB", "MB", "GB", "TB"];
  let value = bytes, unit = 0;
  while (value >= 1000 && unit < units.length - 1) { value /= 1000; unit++; }
  return `${unit && value < 100 ? value.toPrecision(3) : Math.round(value)} ${units[unit]}`;
}

// Returns a list of names and values: [["Time", "3 min"], …].
function values(pairs) {
  const list = element("dl", "values");
  for (const [name, value] of pairs) {
    const box = element("div");
    box.append(element("dt", "", name), element("dd", "", value));
    list.append(box);
  }
  return list;
}

function showPlan(told) {
  const plan = told.plan;
  if (!told.ok) {
    $("plan-answer").replaceChildren(element("p", "mistakes", "This session cannot be captured:"), element("pre", "", told.report));
    return;
  }
  const details = element("details");
  details.append(element("summary", "", "The whole plan"), element("pre", "", told.report));
  $("plan-answer").replaceChildren(
    values([["Time", duration(plan.predicted_s)], ["On disk", size(plan.bytes)], ["Shots", plan.shots], ["Frames", plan.frames],
            ["Views", plan.views], ["Lights", plan.lights]]),
    ...(plan.prompt ? [element("p", "", `Before it begins: ${plan.prompt}`)] : []),
    ...(plan.notes || []).map(note => element("p", "faint", note)), details);
}

async function makePlan() {
  const at = chosen();
  planned = "";
  showCapture();
  $("plan-answer").replaceChildren(element("p", "faint", "The plan is being made …"));
  const told = await act(filePath("plan", sessionQuery({})));
  if (at !== chosen()) return; // another file was chosen meanwhile
  if (told) showPlan(told); else $("plan-answer").replaceChildren();
  if (told && told.ok) planned = at;
  showCapture();
}

async function begin(what) {
  const query = sessionQuery({ process: $("process").checked ? 1 : 0 });
  planned = ""; // a second press must not begin a second capture
  showCapture();
  const told = await act(filePath(what, query));
  if (!told) return;
  $("plan-answer").replaceChildren(element("p", "", what === "start" ? "The capture has begun." : `Added to the queue as number ${told.number}.`));
}

// Offers these values in an element <select>, after those that it always has, and keeps the chosen one.
function choices(select, names, always = []) {
  const old = select.value, shown = [...always, ...names.map(name => [name, name])];
  if (select.dataset.shown === JSON.stringify(shown)) return;
  select.dataset.shown = JSON.stringify(shown);
  select.replaceChildren(...shown.map(([value, label]) => {
    const option = element("option", "", label);
    option.value = value;
    option.selected = value === old;
    return option;
  }));
}

function showSessions(list) {
  const key = JSON.stringify(list);
  if (sessionsShown === key) return; // so that a button in the list keeps the focus
  sessionsShown = key;
  $("sessions").replaceChildren(...list.map(session => {
    const row = element("li");
    const button = actButton("Resume", `Resume ${session.name}`, `sessions/${encodeURIComponent(session.name)}/resume`);
    button.classList.add("resume");
    row.append(element("strong", "", session.name), ` ${new Date(1000 * session.changed).toLocaleString([], { dateStyle: "medium", timeStyle: "short" })}`, button);
    for (const product in productNames) row.append(productButton(session.name, product));
    return row;
  }));
  if (list.length === 0) $("sessions").append(element("li", "faint", "No session yet."));
}

// --- files that are made of a session: report, page with the material in 3D, glTF

const productNames = { report: "Report", page: "3D page", gltf: "glTF file" };
let products = { products: [], making: null, failed: null };

function isMade(session, product) {
  return products.products.find(made => made.session === session && made.product === product);
}

// Returns the button that shows a file, or makes it first.
function productButton(session, product) {
  const button = element("button", "small product", productNames[product]);
  button.setAttribute("aria-label", `${productNames[product]} of ${session}`);
  button.dataset.session = session;
  button.dataset.product = product;
  button.onclick = () => openProduct(session, product);
  return button;
}

async function loadProducts() {
  products = await getJson("products");
  const { making, failed } = products;
  text("product-state", making ? `${productNames[making.product]} of ${making.session} is being made …`
    : failed ? `${productNames[failed.product]} of ${failed.session} could not be made: ${failed.why}` : "");
  showProducts();
}

function showProducts() {
  for (const button of document.querySelectorAll("#sessions .product"))
    button.disabled = !isMade(button.dataset.session, button.dataset.product) &&
      (!sessionStorage.getItem("token") || !!products.making);
}

async function openProduct(session, product) {
  await loadProducts();
  if (!isMade(session, product)) {
    if (!await act(`sessions/${encodeURIComponent(session)}/make?product=${product}`)) return;
    do {
      await loadProducts();
      await new Promise(done => setTimeout(done, products.making ? 1000 : 0));
    } while (products.making);
  }
  const made = isMade(session, product);
  if (!made) {
    if (!products.failed)
      text("product-state", `${session} was changed while its ${productNames[product]} was made. Press again to make it anew.`);
    return;
  }
  const uri = `${api}sessions/${encodeURIComponent(session)}/${made.file}`;
  if (product === "gltf") {
    const link = element("a");
    link.href = uri;
    link.download = `${session}.glb`;
    link.click();
    text("product-state", `${session}.glb (${size(made.bytes)}) is being saved.`);
    return;
  }
  text("product-head", `${productNames[product]} of ${session}`);
  $("product-frame").title = `${productNames[product]} of ${session}`;
  $("product-frame").src = uri;
  $("product").hidden = false;
  $("product-head").scrollIntoView();
}

$("product-close").onclick = () => {
  $("product").hidden = true;
  $("product-frame").removeAttribute("src");
};

async function loadFiles() {
  const told = await getJson("files");
  hasFolder = told.folder;
  fileList = told.files;
  const old = $("file").value;
  choices($("file"), told.files.map(file => file.name));
  if ($("file").value !== old) chooseFile();
  if (hasFolder) {
    sessionList = (await getJson("sessions")).sessions;
    showSessions(sessionList);
    await loadProducts();
    await loadCalibrations();
  }
  showCapture();
}

function chooseFile() {
  $("session-name").value = $("file").value;
  $("plan-answer").replaceChildren();
  showCapture();
}

$("file").onchange = chooseFile;
$("calibration").onchange = () => { $("plan-answer").replaceChildren(); showCapture(); };
$("session-name").oninput = () => { $("plan-answer").replaceChildren(); showCapture(); };
$("capture-form").onsubmit = event => { event.preventDefault(); makePlan(); };
$("start").onclick = () => begin("start");
$("enqueue").onclick = () => begin("queue");
$("queue-pause").onclick = () => act("queue/pause");
$("queue-resume").onclick = () => act("queue/resume");

let lastState = "";
document.addEventListener("rig", () => {
  showCapture();
  const now = `${state.state} ${state.session}`;
  if (now === lastState) return;
  lastState = now; // a capture may have begun or ended
  loadFiles().catch(() => {});
});
