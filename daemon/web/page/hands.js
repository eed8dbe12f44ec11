// Lamps and lasers by hand. mesorigd switches a light off when its lease ends. While a light is on, this script
// renews the lease of a few seconds. When the page is closed, hidden or loses its connection, the light goes off.
"use strict";

const firstLease = 10; // s; a light that needs longer to become stable goes off
const lease = 4;       // s
const renewal = 1500;  // time in ms between two renewals
const longest = 60;    // s after which the page switches a light off

let lit = null; // the light that this page has switched on: {name, path, until (ms), renews (a promise), timer}

function showHands() {
  const lights = (state.places || []).filter(at => at.class === "lamp" || at.class === "laser");
  const token = !!sessionStorage.getItem("token");
  const isFree = ["idle", "done", "aborted"].includes(state.state);
  $("hands-section").hidden = !acts || lights.length === 0 || state.state === "away";
  const key = JSON.stringify(lights.map(at => [at.class, at.name]));
  if ($("light").dataset.shown !== key) {
    $("light").dataset.shown = key;
    $("light").replaceChildren(...["lamp", "laser"].map(name => {
      const group = element("optgroup");
      group.label = name === "lamp" ? "Lamps" : "Lasers";
      group.append(...lights.filter(at => at.class === name).map(at => {
        const option = element("option", "", at.name);
        option.value = `${at.class}s/${encodeURIComponent(at.name)}`;
        return option;
      }));
      return group;
    }).filter(group => group.children.length > 0));
  }
  const isLaser = $("light").value.startsWith("lasers/");
  $("light-on").disabled = !token || !isFree || state.latched || !!lit;
  $("light-off").disabled = !lit;
  $("light").disabled = !!lit;
  text("light-hint", !token ? "Enter the token to switch a light on."
    : state.latched ? "The rig is held in the safe state. Release it to switch a light on."
    : !isFree ? "Lights cannot be used by hand during a capture."
    : `${isLaser ? "Laser: nobody may look into the beam. " : ""}The light goes off after ${longest} s, and when this page is closed or hidden.`);
  // The daemon has ended, or a capture or the safe state has switched the light off.
  if (lit && (state.state === "away" || !isFree || state.latched)) forget("The light was switched off.");
}

// Stops renewing. The daemon has switched the light off, or does so when the lease ends.
function forget(why) {
  if (!lit) return;
  clearInterval(lit.timer);
  lit = null;
  $("light-left").hidden = true;
  text("light-state", why);
  showHands();
}

async function switchOn() {
  const option = $("light").selectedOptions[0];
  if (lit || !option) return;
  const mine = lit = { name: option.textContent, path: option.value, until: Date.now() + 1000 * longest,
                       renews: null, timer: 0 };
  showHands();
  text("light-state", `${mine.name} is being switched on …`);
  mine.renews = send(`${mine.path}/on?for_s=${firstLease}`);
  const { ok, told } = await mine.renews;
  mine.renews = null;
  if (lit !== mine) return;
  if (!ok) return forget(`${mine.name} was not switched on: ${told.error}`);
  text("light-state", `${mine.name} is on.`);
  mine.timer = setInterval(renew, renewal, mine);
  renew(mine);
}

async function renew(mine) {
  const left = Math.ceil((mine.until - Date.now()) / 1000);
  if (lit !== mine || mine.renews) return;
  if (left <= 0) return switchOff(`${mine.name} is off: it was on for ${longest} s.`);
  text("light-left", `It goes off in ${left} s.`);
  $("light-left").hidden = false;
  mine.renews = send(`${mine.path}/on?for_s=${lease}`);
  const { ok, told } = await mine.renews;
  mine.renews = null;
  if (lit === mine && !ok) forget(`${mine.name} is off, or goes off within ${lease} s: ${told.error}`);
}

// Switches the light off. A renewal that is under way is awaited first, because it must not arrive after “off”.
async function switchOff(why) {
  const mine = lit;
  if (!mine) return;
  forget("");
  if (mine.renews) await mine.renews;
  if (await act(`${mine.path}/off`)) text("light-state", why || `${mine.name} is off.`);
}

// The page is closed or hidden. The request is sent even if the page ends. Should a renewal arrive later, the light
// goes off at the end of the lease.
function leave() {
  if (!lit) return;
  const path = lit.path, token = sessionStorage.getItem("token");
  forget("The light was switched off, because this page was hidden.");
  fetch(`${api}${path}/off`, { method: "POST", keepalive: true, headers: { Authorization: `Bearer ${token}` } }).catch(() => {});
}

$("hands-form").onsubmit = event => { event.preventDefault(); switchOn(); };
$("light-off").onclick = () => switchOff();
$("light").onchange = showHands;
addEventListener("pagehide", leave);
document.addEventListener("visibilitychange", () => document.hidden && leave());
document.addEventListener("rig", showHands);
