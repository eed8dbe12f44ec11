// Live view: pictures on request, with the histogram of the sensor's values, the focus, and a zoom to the pixels.
"use strict";

const zoomPixels = 128;     // width and height of the zoom in pixels of the sensor, as the server has it
const snapInterval = 500;   // ms between two pictures
let snapped = null;         // values of the last picture
let best = 0;               // best focus of this camera since the exposure or the camera was chosen
let snapping = false;

function showSnap() {
  const names = (state.devices || []).filter(device => device.class === "camera").map(device => device.name);
  const token = !!sessionStorage.getItem("token");
  const isFree = ["idle", "done", "aborted"].includes(state.state);
  $("snap-section").hidden = !acts || names.length === 0 || state.state === "away";
  if ($("snap-camera").dataset.shown !== JSON.stringify(names)) {
    $("snap-camera").dataset.shown = JSON.stringify(names);
    $("snap-camera").replaceChildren(...names.map(name => element("option", "", name)));
  }
  $("snap").disabled = !token || !isFree || snapping;
  text("snap-hint", !token ? "Enter the token to take pictures."
    : !isFree ? "Pictures on request cannot be taken during a capture." : "Switch a light on by hand to see something.");
  if (!token || !isFree) $("snap-again").checked = false;
}

function percent(part) {
  return `${(100 * part).toFixed(part > 0 && part < 0.01 ? 2 : 1)} %`;
}

function showValues() {
  const top = 2 ** snapped.bits - 1, most = Math.max(1, ...snapped.histogram);
  best = Math.max(best, snapped.focus);
  $("snap-values").replaceChildren(values([
    ["Mean", `${Math.round(snapped.mean_dn)} of ${top} DN`], ["Brightest", `${Math.round(snapped.max_dn)} DN`],
    ["Saturated", percent(snapped.saturated)], ["Dark", percent(snapped.dark)],
    ["Focus", snapped.focus > 0 ? snapped.focus.toFixed(4) : "too dark"],
    ["Best focus", best > 0 ? best.toFixed(4) : "–"]]));
  const bars = snapped.histogram.map((n, i) => svg("path", {
    d: `M${i} 32V${32 - 31 * Math.sqrt(n / most)}H${i + 0.9}V32Z`, class: i === snapped.histogram.length - 1 ? "full" : "" }));
  $("snap-histogram").replaceChildren(...bars);
  text("snap-range", `Values of the sensor from 0 to ${top} DN (${snapped.width} × ${snapped.height} pixels, ` +
    `${snapped.cfa === "mono" ? "no colour filter" : `colour filter ${snapped.cfa}`}), exposed for ${snapped.exposure_us} µs. ` +
    "Heights are square roots, so that few pixels stay visible. The last step, in red, has saturated pixels.");
}

// Shows the part of the picture that the sliders choose, pixel by pixel.
function showZoom() {
  if (!snapped) return;
  const at = (id, size) => Math.round($(id).value / 100 * Math.max(0, size - zoomPixels));
  const x = at("zoom-x", snapped.width), y = at("zoom-y", snapped.height);
  const name = encodeURIComponent(snapped.camera);
  $("snap-pixels").src = `${api}cameras/${name}/pixels.png?x=${x}&y=${y}&t=${snapped.taken}`;
  $("snap-pixels").alt = `pixels of ${snapped.camera} from column ${x}, row ${y}`;
  text("snap-part", `Pixels of the sensor, from column ${x}, row ${y}. Saturated pixels are red.`);
}

async function takePicture() {
  const camera = $("snap-camera").value;
  if (snapping || !camera || !$("exposure").checkValidity()) return;
  snapping = true;
  showSnap();
  const told = await act(`cameras/${encodeURIComponent(camera)}/snap?exposure_us=${$("exposure").value}`);
  snapping = false;
  if (told) {
    snapped = { ...told, taken: Date.now() };
    $("snap-answer").hidden = false;
    $("snap-picture").src = `${api}cameras/${encodeURIComponent(camera)}/snap.png?t=${snapped.taken}`;
    $("snap-picture").alt = `picture of ${camera}`;
    showValues();
    showZoom();
  } else $("snap-again").checked = false;
  showSnap();
  if ($("snap-again").checked && !document.hidden) setTimeout(takePicture, snapInterval);
}

$("snap-form").onsubmit = event => { event.preventDefault(); takePicture(); };
for (const id of ["snap-camera", "exposure"]) $(id).onchange = () => { best = 0; };
for (const id of ["zoom-x", "zoom-y"]) $(id).oninput = showZoom;
$("snap-picture").onclick = event => {
  if (!snapped) return;
  const box = $("snap-picture").getBoundingClientRect();
  const slide = (part, size) => 100 * Math.min(1, Math.max(0, (part * size - zoomPixels / 2) / Math.max(1, size - zoomPixels)));
  $("zoom-x").value = slide((event.clientX - box.left) / box.width, snapped.width);
  $("zoom-y").value = slide((event.clientY - box.top) / box.height, snapped.height);
  showZoom();
};
document.addEventListener("visibilitychange", () => { if (document.hidden) $("snap-again").checked = false; });
document.addEventListener("rig", showSnap);
