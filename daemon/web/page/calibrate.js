// The calibration of the rig, step by step: capture a target, find it in the pictures, look at what was found.
"use strict";

// The steps in their order. A step captures a target with a session file whose name contains one of the words. The
// option is what mesorig has to know about the target.
const calibrationSteps = {
  cameras: {
    title: "Cameras", words: /board/i, device: "camera",
    option: "The board, as measured, in mm", value: "8x8,square=9,marker=6.75,thickness=3",
    text: "Print the board in true size, glue the print on a flat plate, and measure the print. thickness is the height of the print above the turntable. " +
          "Lay the board flat on the turntable and capture it. Then lean it by 15°, and by 35° towards another side, and capture it each time. " +
          "Without a turntable, capture it flat, and leaning by 15° to 30° towards five sides.",
  },
  lights: {
    title: "Lamps", words: /light|lamp|pole|ball/i, device: "lamps",
    text: "Lay the plate with posts, or with glossy balls, on the turntable, within 5 mm and 5° of its place. Capture it once. " +
          "The target is the file that says where the posts or balls are.",
  },
  laser: {
    title: "Lasers", words: /plate|laser/i, device: "laser",
    text: "Lay a flat, matt plate on the turntable. Capture it at two heights, for example 1 mm and 8 mm. Each height has its own session file, " +
          "whose reference_mm is the height of the upper face. Wear goggles.",
  },
  radiometry: {
    title: "Brightness", words: /tile/i, device: "lamps",
    option: "Reflectance of the tile, from 0.05 to 1.2", value: "0.96",
    text: "Lay the white tile in the middle of the turntable, where it covers the whole place of the sample. reference_mm of the session file is the height of " +
          "its upper face. Leave white discs next to the samples where they are. Capture it once.",
  },
  report: {
    title: "Report", text: "Read the report. Its first lines say what to check. Then use the calibration: new captures can choose it. " +
          "To use it in every capture, name it in the rig file: calibration = NAME.calibration in the section [rig].",
  },
};

let calibrations = { targets: [], calibrations: [], drafts: [], working: null, failed: null };
let calibrationName = ""; // the calibration that is shown; "" before one is begun
let calibrationStep = "cameras";
const leftOut = new Set(); // names of sessions that were unchecked
const optionValues = Object.fromEntries(Object.entries(calibrationSteps).map(([name, step]) => [name, step.value]));
let watchesCalibration = false;

function draftOf(name) {
  return calibrations.drafts.find(draft => draft.name === name) || { name, steps: [], files: [] };
}

function isKept(name) {
  return calibrations.calibrations.some(each => each.name === name);
}

function stepResult(step) {
  return draftOf(calibrationName).steps.find(each => each.step === step);
}

// Returns the steps that this rig needs.
function neededSteps() {
  const has = name => (state.devices || []).some(device => device.class === name);
  return Object.keys(calibrationSteps).filter(name => !calibrationSteps[name].device || has(calibrationSteps[name].device));
}

function stepSessions() {
  const prefix = `${calibrationName}-${calibrationStep}-`;
  return sessionList.map(session => session.name).filter(name => name.startsWith(prefix));
}

function calibrationPath(what, query = {}) {
  return `calibrations/${encodeURIComponent(calibrationName)}/${what}?${new URLSearchParams(query)}`;
}

async function loadCalibrations() {
  calibrations = await getJson("calibrations");
  $("drafts").replaceChildren(...calibrations.drafts.map(draft => { const option = element("option"); option.value = draft.name; return option; }));
  choices($("calibration"), calibrations.calibrations.map(each => each.name), [["", "of the rig file"]]);
  choices($("step-target"), calibrations.targets.map(target => target.name));
  showCalibration();
  if (calibrations.working && !watchesCalibration) watchCalibration();
}

async function watchCalibration() {
  watchesCalibration = true;
  while (calibrations.working) {
    await new Promise(done => setTimeout(done, 1000));
    await loadCalibrations().catch(() => {});
  }
  watchesCalibration = false;
}

function showStepButtons() {
  const steps = neededSteps(), key = JSON.stringify([steps, calibrationStep, draftOf(calibrationName).steps.map(each => each.step)]);
  if ($("calibrate-steps").dataset.shown === key) return; // so that a button keeps the focus
  $("calibrate-steps").dataset.shown = key;
  $("calibrate-steps").replaceChildren(...steps.map((name, i) => {
    const row = element("li"), done = !!stepResult(name);
    const button = element("button", "small", `${i + 1} ${calibrationSteps[name].title}${done ? " ✓" : ""}`);
    button.setAttribute("aria-label", `Step ${i + 1}: ${calibrationSteps[name].title}${done ? ", done" : ""}`);
    if (name === calibrationStep) button.setAttribute("aria-current", "step");
    button.dataset.step = name;
    button.onclick = () => goToStep(name);
    row.append(button);
    return row;
  }));
}

function showStepSessions() {
  const names = stepSessions(), key = JSON.stringify(names);
  $("step-sessions").hidden = names.length === 0;
  if ($("step-list").dataset.shown === key) return;
  $("step-list").dataset.shown = key;
  $("step-list").replaceChildren(...names.map(name => {
    const row = element("li"), label = element("label"), box = element("input");
    box.type = "checkbox";
    box.checked = !leftOut.has(name);
    box.onchange = () => { if (box.checked) leftOut.delete(name); else leftOut.add(name); showCalibration(); };
    label.append(box, name);
    const resume = actButton("Resume", `Resume ${name}`, `sessions/${encodeURIComponent(name)}/resume`);
    resume.classList.add("resume");
    label.append(resume);
    row.append(label);
    return row;
  }));
}

// Shows a page of the draft in the frame: that of a step, "report" or "failed"; "" for none. version is any text that
// changes with the page.
function showFrame(step, version) {
  const key = `${calibrationName}/${step}/${version}`;
  $("step-frame").hidden = !step;
  if ($("step-frame").dataset.shown === key) return;
  $("step-frame").dataset.shown = key;
  if (step) $("step-frame").src = api + calibrationPath("page.html", { step });
  else $("step-frame").removeAttribute("src");
}

function showStepResult() {
  const { working, failed } = calibrations, draft = draftOf(calibrationName), result = stepResult(calibrationStep);
  const isHere = each => each && each.name === calibrationName && (each.step === calibrationStep || (each.step === "board" && calibrationStep === "cameras"));
  const why = isHere(failed) ? failed.why : "";
  $("step-state").className = why && !working ? "bad" : "";
  text("step-state", working ? (isHere(working) ? "The pictures are being searched …" : `A step of the calibration ${working.name} is being computed.`)
    : why ? `${why} Nothing is lost: capture the target again, or leave out a session, and try again.` : "");
  const isReport = calibrationStep === "report", hasPage = draft.files.includes(`${calibrationStep}.html`);
  $("step-result").hidden = !result || !!why;
  text("step-result", result ? result.text : "");
  if (working && isHere(working)) showFrame("", "");
  else if (why && failed.step !== "board" && draft.files.includes("failed.html")) showFrame("failed", why);
  else showFrame(hasPage && (isReport || result) ? calibrationStep : "", result ? result.text : draft.steps.map(each => each.text).join());
}

// Shows the calibration, and enables the buttons that are of use now.
function showCalibration() {
  const token = !!sessionStorage.getItem("token"), isFree = ["idle", "done", "aborted"].includes(state.state);
  const step = calibrationSteps[calibrationStep], kept = isKept(calibrationName), busy = !!calibrations.working;
  const isReport = calibrationStep === "report", steps = neededSteps();
  $("calibrate-section").hidden = !hasFolder || !acts;
  $("calibrate").disabled = !token;
  text("calibrate-hint", !token ? "Enter the token to calibrate."
    : kept ? `${calibrationName}.calibration is stored. Choose another name to calibrate again.`
    : "The steps can be done on several days: they are kept under this name.");
  $("calibrate-area").hidden = !calibrationName;
  if (!calibrationName) return;
  showStepButtons();
  text("step-head", step.title);
  text("step-text", step.text);
  $("step-option-label").hidden = !step.option;
  text("step-option-name", step.option || "");
  $("step-target-label").hidden = calibrationStep !== "lights";
  $("step-board").hidden = calibrationStep !== "cameras";
  $("step-board-file").hidden = calibrationStep !== "cameras" || !draftOf(calibrationName).files.includes("board.pdf");
  $("step-board-file").href = api + calibrationPath("board.pdf");
  for (const id of ["step-file-label", "step-capture", "step-plan"]) $(id).hidden = isReport;
  showStepSessions();
  if (isReport) $("step-sessions").hidden = true;
  text("step-find", isReport ? "Make the report" : "Find it in the pictures");
  const sessions = stepSessions().filter(name => !leftOut.has(name));
  $("step-board").disabled = !token || busy || kept;
  $("step-capture").disabled = !token || !isFree || state.latched || kept || !$("step-file").value;
  text("step-capture", stepSessions().length ? "Capture again" : "Capture");
  $("step-find").disabled = !token || busy || kept || (isReport ? draftOf(calibrationName).steps.length === 0 : sessions.length === 0);
  $("step-next").hidden = isReport || steps.indexOf(calibrationStep) + 1 >= steps.length;
  $("step-keep").hidden = !isReport;
  $("step-keep").disabled = !token || busy || kept || draftOf(calibrationName).steps.length === 0;
  for (const button of document.querySelectorAll("#step-list .resume")) button.disabled = !token || !isFree || state.latched;
  if (!isReport && ["running", "homing", "pausing", "paused"].includes(state.state) && (state.session || "").includes(`/${calibrationName}-${calibrationStep}-`))
    text("step-plan", `${state.shots_done} of ${state.shots} shots are taken. ${state.state === "paused" ? state.reason || "Press Continue at the top of the page." : ""}`);
  else if (!$("step-plan").dataset.keeps) text("step-plan", "");
  showStepResult();
}

function goToStep(name) {
  calibrationStep = name;
  const step = calibrationSteps[name];
  $("step-option").value = optionValues[name] || "";
  choices($("step-file"), fileList.map(file => file.name));
  const fitting = fileList.find(file => step.words && step.words.test(file.name));
  if (fitting) $("step-file").value = fitting.name;
  tellPlan("");
  showCalibration();
  $("step-head").focus();
}

// Shows a sentence below the button “Capture” until the next one.
function tellPlan(sentence) {
  if (sentence) $("step-plan").dataset.keeps = "1"; else delete $("step-plan").dataset.keeps;
  text("step-plan", sentence);
}

function beginCalibration() {
  const name = $("calibration-name").value.trim();
  if (!name) { text("calibrate-hint", "Give the calibration a name."); return; }
  calibrationName = name;
  const next = neededSteps().find(step => !stepResult(step));
  goToStep(next || "report");
}

// Captures the target with the checks of a plan. The name of the session is that of the calibration and the step, and a
// number that is not yet used.
async function captureTarget() {
  let n = 1;
  while (sessionList.some(session => session.name === `${calibrationName}-${calibrationStep}-${n}`)) n++;
  const query = { session: `${calibrationName}-${calibrationStep}-${n}` };
  const path = what => `files/${encodeURIComponent($("step-file").value)}/${what}?${new URLSearchParams(query)}`;
  $("step-capture").disabled = true;
  tellPlan("The plan is being made …");
  const told = await act(path("plan"));
  if (!told || !told.ok) { tellPlan(told ? told.report : ""); showCalibration(); return; }
  const begun = await act(path("start"));
  tellPlan(begun ? `The capture has begun. It takes ${duration(told.plan.predicted_s)} and ${size(told.plan.bytes)}.` : "");
  if (begun) setTimeout(() => { tellPlan(""); showCalibration(); }, 3000);
}

async function findTarget(step) {
  const query = { step };
  if (step === "board" || step === "cameras") query.board = $("step-option").value;
  if (step === "radiometry") query.reflectance = $("step-option").value;
  if (step === "lights") query.target = $("step-target").value;
  if (!["board", "report"].includes(step)) query.sessions = stepSessions().filter(name => !leftOut.has(name)).join("/");
  $("step-find").disabled = true;
  await act(calibrationPath("find", query));
  await loadCalibrations();
}

async function keepCalibration() {
  $("step-keep").disabled = true;
  const kept = await act(calibrationPath("keep"));
  await loadCalibrations();
  if (!kept) return;
  $("calibration").value = calibrationName;
  $("calibration").onchange();
  text("step-state", `${calibrationName}.calibration is stored, and chosen for the next capture.`);
}

$("calibrate-form").onsubmit = event => { event.preventDefault(); beginCalibration(); };
$("step-form").onsubmit = event => { event.preventDefault(); findTarget(calibrationStep); };
$("step-option").oninput = () => { optionValues[calibrationStep] = $("step-option").value; };
$("step-board").onclick = () => findTarget("board");
$("step-capture").onclick = captureTarget;
$("step-next").onclick = () => { const steps = neededSteps(); goToStep(steps[steps.indexOf(calibrationStep) + 1]); };
$("step-keep").onclick = keepCalibration;
document.addEventListener("rig", showCalibration);
