// What the station says, in words and colours. Every figure that is not known is a dash.

const AMBER_S = 1, RED_S = 3, SAID_MS = 9000, MOST_SAID = 4, LOW_BATTERY = 0.25, LIMIT_MS = 1200;
const PARTS = ["glass", "decode", "wait", "tracker", "control", "link"];

/** Whether a finger steers: then keys are not spoken of. */
export const isTouch = matchMedia("(hover: none) and (pointer: coarse)").matches;

export const by = (id) => document.getElementById(id);

/** Only what changes is touched: the browser then has nothing to lay out anew. */
export function text(id, value) {
  const node = by(id);
  if (node.textContent !== value) node.textContent = value;
}

const fixed = (value, digits = 1, unit = "") => (value === null || value === undefined ? "–" : value.toFixed(digits) + unit);
const percent = (value) => (value === null || value === undefined ? "–" : `${Math.round(value * 100)} %`);

function level(id, name) {
  if (by(id).dataset.level !== name) by(id).dataset.level = name;
}

function list(id, lines) {
  const node = by(id), key = lines.join("\n");
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...lines.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
}

export function banner(tone, state, reason) {
  by("banner").dataset.tone = tone;
  text("state", state);
  text("reason", reason);
}

/** What to do next, where the station has nothing to say. */
export function hint({ state, engaging, refusals, vehicle }) {
  if (state === "idle" && !vehicle.in_air) return "take off: Flight, or your transmitter";
  if (state === "idle") return "drag a box round the target, or tap it";
  if (state === "selected" && !engaging) return refusals.length ? "cannot follow yet" : "hold FOLLOW for a second";
  if (["released", "taken over"].includes(state)) return "press OK, SEEN to go on";
  return "";
}

export function showStatus(status) {
  const { vehicle } = status;
  text("vehicle-mode", vehicle.mode.toUpperCase());
  text("armed", vehicle.armed ? (vehicle.in_air ? "FLYING" : "ARMED") : "DISARMED");
  text("height", fixed(vehicle.height_m));
  text("speed", fixed(vehicle.speed_mps));
  text("battery", percent(vehicle.battery_frac));
  level("battery", vehicle.battery_frac !== null && vehicle.battery_frac < LOW_BATTERY ? "red" : "");
  text("fps", fixed(status.fps, 0));
  by("recording").hidden = status.recording !== true;
  by("record").setAttribute("aria-pressed", String(status.recording === true));
  by("record").disabled = status.recording === null;
  text("confidence", percent(status.confidence));
  by("confidence-bar").style.width = `${Math.round((status.confidence ?? 0) * 100)}%`;
  level("confidence-bar", (status.confidence ?? 0) < 0.3 ? "red" : status.confidence < 0.6 ? "amber" : "");
  text("distance", fixed(status.distance_m, 1, " m"));
  text("standoff", fixed(status.standoff_m, 1, " m"));
  text("mode", status.mode);
  showLimits(status.limits);
  list("warnings", status.warnings);
  text("link-line", status.link);
  showLatency(status.latency);
}

const clippedAt = new Map();

/** A limit that clips for a moment can still be read. */
function showLimits(names) {
  const now = performance.now();
  for (const name of names) clippedAt.set(name, now);
  for (const [name, at] of clippedAt) if (now - at > LIMIT_MS) clippedAt.delete(name);
  list("limits", clippedAt.size ? [...clippedAt.keys()] : ["nothing"]);
  level("limits-item", clippedAt.size ? "amber" : "");
}

function showLatency(latency) {
  text("latency", latency ? `${Math.round(latency.total_ms)} ms` : "–");
  const parts = latency ? PARTS.filter((name) => latency[name] !== undefined) : [];
  text("latency-parts", parts.map((name) => `${name} ${Math.round(latency[name])}`).join(" · "));
  const bar = by("latency-bar");
  if (bar.children.length !== parts.length) {
    bar.replaceChildren(...parts.map((name) => Object.assign(document.createElement("i"), { className: name, title: name })));
  }
  parts.forEach((name, at) => { bar.children[at].style.flexGrow = String(Math.max(0, latency[name])); });
}

/** ages_s as they were sinceMs ago. */
export function showAges(ages_s, sinceMs) {
  for (const name of ["video", "heartbeat", "attitude", "position"]) {
    const age_s = ages_s?.[name];
    const now_s = age_s === null || age_s === undefined ? null : age_s + sinceMs / 1000;
    text(`age-${name}`, now_s === null ? "none" : now_s < AMBER_S ? `${now_s.toFixed(2)} s` : `${now_s.toFixed(1)} s`);
    level(`age-${name}`, now_s === null || now_s > RED_S ? "red" : now_s > AMBER_S ? "amber" : "");
  }
}

export function showControl(status, isArmed) {
  const { controller, in_control: mine, viewers } = status;
  text("who", mine ? "You are in control" : controller ? `${controller} is in control` : "Nobody is in control");
  text("viewers", viewers === 1 ? "1 viewer" : `${viewers} viewers`);
  by("control").dataset.mine = String(mine);
  text("take", mine ? "Give back" : isArmed ? "Press again to take it" : controller ? `Take from ${controller}` : "Take control");
}

export function showRefusals(lines) {
  by("refusals").hidden = lines.length === 0;
  list("refusals", lines);
}

/** tone: "", "alarm". */
export function say(line, tone = "") {
  const says = by("says");
  const item = Object.assign(document.createElement("li"), { textContent: line, className: tone });
  const last = says.lastElementChild;
  if (last?.textContent === line) last.remove();
  says.append(item);
  while (says.children.length > MOST_SAID) says.firstElementChild.remove();
  setTimeout(() => item.classList.add("gone"), SAID_MS);
  setTimeout(() => item.remove(), SAID_MS + 1000);
}

/** Over the picture; head null: nothing. */
export function notice(head, line = "", isBusy = false) {
  const node = by("notice");
  node.hidden = head === null;
  node.classList.toggle("busy", isBusy);
  text("notice-head", head ?? "");
  text("notice-text", line);
}
