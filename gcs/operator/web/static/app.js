// The operator's page: what comes in is shown, what is done is asked for. Nothing is kept over a lost connection.

import { Abort } from "./abort.js";
import { ring, wake } from "./bell.js";
import { drawer } from "./drawer.js";
import { Following } from "./following.js";
import { keys } from "./keys.js";
import { Link } from "./link.js";
import { SceneMap } from "./map.js";
import { Nudge } from "./nudge.js";
import { Overlay } from "./overlay.js";
import { banner, by, hint, isTouch, notice, say, showAges, showControl, showStatus } from "./panels.js";
import { Pictures } from "./pictures.js";
import { pointing } from "./pointing.js";
import { Targets } from "./targets.js";
import { webrtc } from "./live.js";

const STALE_MS = 1500; // unheard for so long: what is shown is old
const FORCE_MS = 3000;
const STEP_M = 2;
const MODES = ["spotlight", "follow", "parallel", "orbit"];
const ABORT_HINT = isTouch ? "at once" : "Space or Esc";
const WORSE = { calm: 0, good: 0, caution: 1, alarm: 2 };

const page = {
  welcome: null,
  starting: "",
  hadStation: false, // in this connection, or the last one
  status: null,
  statusAt: 0,
  shownAt: 0,
  shown: null, // {seq, image, width, height, frame}: the picture on the screen with what belongs to it
  drawn: null, // the box being drawn
  forceUntil: 0,
  replay: null, // what plays a recording
};

const overlay = new Overlay(by("picture"));
const map = new SceneMap(by("map"));
const size = () => (page.welcome ? { width: page.welcome.size[0], height: page.welcome.size[1] } : page.shown ?? { width: 16, height: 9 });
const shownSeq = () => page.shown?.seq ?? null;

const pictures = new Pictures(show, (seq) => link.tell({ do: "seen", frame: seq }));
const link = new Link({ heard, pictured: (picture) => pictures.arrived(picture), changed });
const abort = new Abort(link, showAbort);
const nudge = new Nudge(() => page.shown ?? {}, size, (box, seq) => order({ do: "select", box, frame: seq }));
const targets = new Targets({ link, order, size, shown: () => page.shown, redraw });
const following = new Following({ link, order, page: () => page });
const live = webrtc({ link, isOffered: () => page.welcome?.webrtc === true, shown: liveShown });

/** Ask, and say what was answered. */
async function order(message, isQuiet = false) {
  const answer = await link.ask(message);
  if (!answer.ok || !isQuiet) say(answer.text, answer.ok ? "" : "alarm");
  return answer;
}

// -- what comes in ------------------------------------------------------------------------------------------

function heard(message) {
  switch (message.type) {
    case "starting": return starting(message);
    case "welcome": return welcomed(message);
    case "frame": return pictures.heard(message);
    case "status": return statusCame(message);
    case "map": return map.show(message);
    case "candidates": return targets.heard(message.boxes);
    case "say": return say(message.text);
    case "timeline": case "playhead": return replayed(message);
  }
}

/** Of a recording: it is played, not ordered. */
async function replayed(message) {
  const { Replay } = await import("./replay.js");
  page.replay ??= new Replay({ link, help: acts.help });
  page.replay.heard(message);
}

function starting({ text: line }) {
  forget();
  Object.assign(page, { welcome: null, status: null, starting: line });
  document.body.dataset.station = "no";
  banner("calm", "STARTING", "");
  following.update();
  refresh();
}

function welcomed(message) {
  if (page.replay && !message.replay) return location.reload(); // a flight now: its keys abort
  forget();
  Object.assign(page, { welcome: message, starting: "", hadStation: true });
  document.body.dataset.station = "yes";
  document.title = message.watermark ? `${message.watermark} · Operator` : "Operator";
  by("watermark").textContent = message.watermark ?? "";
  by("frame").hidden = !message.watermark;
  by("stage").style.setProperty("--ratio", String(message.size[0] / message.size[1]));
  by("webrtc").hidden = !message.webrtc;
  document.body.toggleAttribute("data-replay", message.replay);
  targets.welcomed();
  refresh();
}

/** What was on the screen belongs to a connection or a station that is gone. */
function forget() {
  following.void("the connection began anew");
  nudge.clear();
  pictures.forget();
  live.stop();
  point.cancel();
}

function statusCame(status) {
  const before = page.status;
  Object.assign(page, { status, statusAt: performance.now() });
  showStatus(status);
  const state = status.engaging ? "ENGAGING" : status.state.toUpperCase();
  banner(status.tone, state, status.reasons.join("; ") || (page.welcome?.replay ? "" : hint(status)));
  if (before && WORSE[status.tone] > WORSE[before.tone]) ring(WORSE[status.tone] + 1, 880);
  if (status.in_control || !status.controller) page.forceUntil = 0;
  if (before?.selection !== status.selection) nudge.by = null;
  following.update();
  refresh();
}

function changed(isOpen) {
  following.void("the connection was lost");
  targets.stop();
  if (!isOpen) {
    live.stop();
    nudge.clear();
  }
  refresh();
}

function show(picture) {
  const old = page.shown?.image;
  page.shown = picture;
  page.shownAt = performance.now();
  old?.close?.(); // an ImageBitmap or a VideoFrame
  redraw();
}

function liveShown(seq, image) {
  const width = image.displayWidth ?? image.videoWidth, height = image.displayHeight ?? image.videoHeight;
  show({ seq, image, width, height, frame: pictures.nearest(seq) });
}

// -- what is shown ------------------------------------------------------------------------------------------

let isDrawing = false;

function redraw() {
  if (isDrawing) return;
  isDrawing = true;
  requestAnimationFrame(() => {
    isDrawing = false;
    const { shown, status, drawn } = page;
    overlay.draw({ image: shown?.image, size: size(), frame: shown?.frame, tone: status?.tone, candidates: targets.boxes, drawn, nudged: nudge.box });
    by("picture").dataset.frame = String(shown?.seq ?? "");
    placeFrame();
  });
}

function placeFrame() {
  const { left, top, width, height } = overlay.place;
  const key = [left, top, width, height].map((px) => `${px}px`);
  const { style } = by("frame");
  [style.left, style.top, style.width, style.height] = key;
}

/** A few times a second, and whenever something changes: ages go on counting when nothing comes. */
function refresh() {
  const { welcome, status } = page;
  const isLost = !link.isOpen || link.silentMs > STALE_MS;
  document.body.dataset.link = isLost ? "lost" : "up";
  if (isLost) following.void("the connection was lost");
  if (status) {
    showAges(status.ages_s, performance.now() - page.statusAt);
    showControl(status, performance.now() < page.forceUntil);
  }
  const age_s = (link.silentMs / 1000).toFixed(1);
  if (page.replay?.isStill) page.shownAt = performance.now(); // as it was asked to
  const stoppedMs = page.shown ? performance.now() - page.shownAt : 0;
  const isOld = !isLost && welcome !== null && stoppedMs > STALE_MS;
  document.body.dataset.picture = isOld ? "old" : "";
  if (link.refused && isLost) notice("NO LONGER LET IN", "The station was started anew: open the link that it printed.");
  else if (isLost && welcome) {
    banner("alarm", "CONNECTION LOST", `${age_s} s · last: ${status?.headline ?? "nothing"}`);
    notice("CONNECTION LOST", `What you see is ${age_s} s old. ABORT is sent another way.`, true);
  } else if (isLost && page.hadStation) {
    banner("calm", "ENDED", "");
    notice("THE STATION HAS ENDED", "Start it again, and open the link that it prints.");
  } else if (isLost) notice("Connecting", link.reason || "to the station", true);
  else if (!welcome) notice("Starting", page.starting, true);
  else if (!page.shown) notice("No picture yet", "", true);
  else if (isOld) notice("NO NEW PICTURE", `What you see is ${(stoppedMs / 1000).toFixed(1)} s old.`);
  else notice(null);
  following.show(isLost);
}

function showAbort(phase, line) {
  by("abort").dataset.phase = phase;
  by("abort-hint").textContent = line || ABORT_HINT;
  if (phase === "failed") say(`abort: ${line}`, "alarm");
}

// -- what is done -------------------------------------------------------------------------------------------

const point = pointing(by("picture"), overlay, {
  size,
  shownSeq: () => (page.replay ? null : shownSeq()),
  drawing: (box) => {
    page.drawn = box;
    redraw();
  },
  box: (box, seq) => order({ do: "select", box: box.map(round), frame: seq }),
  point: (x, y, seq) => {
    const number = targets.at(x, y);
    if (number === null) order({ do: "point", x: round(x), y: round(y), frame: seq });
    else targets.pick(number);
  },
  tooSmall: () => say("the box is too small: 10 pixels of the picture at least"),
});

const round = (value) => Math.round(value * 10) / 10;

async function take() {
  const { status } = page;
  if (!status) return;
  if (status.in_control) return void order({ do: "release" });
  const isForced = performance.now() < page.forceUntil;
  page.forceUntil = 0;
  if (!isForced && status.controller) page.forceUntil = performance.now() + FORCE_MS;
  else await order({ do: "take", force: isForced });
  refresh();
}

const acts = {
  replayed: (event) => page.replay?.key(event),
  abort: () => {
    following.void("aborted");
    drawing.void("aborted");
    point.cancel();
    nudge.clear();
    abort.press();
    drawing.close();
  },
  held: (isDown) => (isDown ? following.press() : following.leave()),
  track: () => targets.track(),
  candidates: () => targets.toggle(),
  pick: (number) => targets.pick(number),
  drop: () => order({ do: "deselect" }),
  mode: () => order({ do: "mode", mode: MODES[(MODES.indexOf(page.status?.mode) + 1) % MODES.length] }),
  record: () => order({ do: "record", on: null }),
  ack: () => by("ack").hidden || order({ do: "ack" }),
  closer: () => following.step(-STEP_M),
  farther: () => following.step(STEP_M),
  drawer: () => drawing.toggle("drawer"),
  help: () => drawing.toggle("help"),
  webrtc: () => live.toggle(),
  nudge: (dx, dy, grow) => {
    nudge.add(dx, dy, grow);
    redraw();
  },
};

const drawing = drawer({ order });
keys(acts);
by("abort").addEventListener("pointerdown", (event) => event.button === 0 && acts.abort()); // at once, not when let go
by("abort").addEventListener("click", (event) => event.detail === 0 && acts.abort()); // Enter, or a screen reader
const same = ["track", "drop", "record", "mode", "ack", "closer", "farther", "webrtc"].map((id) => [id, acts[id]]);
const buttons = { ...Object.fromEntries(same), take, boxes: acts.candidates, orders: acts.drawer, keys: acts.help };
for (const [id, act] of Object.entries(buttons)) {
  by(id).addEventListener("click", () => {
    by(id).blur(); // keys are for the page
    act();
  });
}
const giveUp = () => {
  following.void("the window was left");
  drawing.void("the window was left");
};
addEventListener("blur", giveUp);
document.addEventListener("visibilitychange", () => document.hidden && giveUp());
addEventListener("pointerdown", wake, { once: true });
addEventListener("keydown", wake, { once: true });
new ResizeObserver(redraw).observe(by("stage"));
new ResizeObserver(() => map.draw()).observe(by("map"));
document.addEventListener("contextmenu", (event) => event.target.matches("input") || event.preventDefault());
setInterval(refresh, 200);
setInterval(() => page.status?.in_control && link.tell({ do: "ping" }), 1000);
const stayAwake = () => document.hidden || navigator.wakeLock?.request("screen").catch(() => {}); // only where served securely
document.addEventListener("visibilitychange", stayAwake);
stayAwake();
notice("Connecting", "to the station", true);
showAbort("idle", "");
by("ack-hint").textContent = isTouch ? "" : "Enter";
link.start();
