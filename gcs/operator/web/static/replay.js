// A recording's player: the states along a line, and where it stands. Loaded only where the station is one.

import { by, say, text } from "./panels.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 10, 20];
const STEP_S = 5, EVENT_S = 0.5; // what an order brings about so soon is one event with it
const SEEK_MS = 100; // between two of a drag
const LOST = ["COASTING", "LOST, HOLDING"];
const FORMS = {
  before: "M2 3h3v18H2zM22 3v18L7 12z", back: "M17 3v18L3 12zM19 3h3v18h-3z", play: "M5 2v20l16-10z", pause: "M4 3h6v18H4zM14 3h6v18h-6z",
  on: "M7 3v18l14-9zM2 3h3v18H2z", after: "M19 3h3v18h-3zM2 3v18l15-9z",
};
const HELP = [
  ["Space", "go on, stand still"], ["← →", "5 s back, on; with Shift 30 s"], [", .", "one picture back, on"], ["P N", "the event before, the next one"],
  ["− +", "slower, faster"], ["Home End", "to the beginning, to the end"], ["H", "this"],
];
const BAR = `
  <div id="timeline" role="slider" tabindex="0" aria-label="Time" aria-valuemin="0"><div id="stretches"></div><div id="marks"></div><i id="head"></i><b id="peek" hidden></b></div>
  <div id="buttons"></div>
  <p id="clock"><b id="at">0:00.0</b><span id="span"></span><span id="day"></span><span id="number"></span></p>
  <p id="lately"></p>
  <select id="rate" aria-label="Speed"></select>`;

const clock = (t_s) => `${Math.floor(t_s / 60)}:${(t_s % 60).toFixed(1).padStart(4, "0")}`;
const rateOf = (times) => (times < 1 ? `1/${Math.round(1 / times)}` : `${times}`) + "×";

export class Replay {
  constructor({ link, help }) {
    Object.assign(this, { link, timeline: { span_s: 0, stretches: [], events: [] }, head: { t_s: null, playing: false, speed: 1 } });
    this.wanted_s = null; // where to, not yet asked for
    this.isAsking = false;
    this.events = []; // to jump to: {begin_s, end_s}
    const style = Object.assign(document.createElement("link"), { rel: "stylesheet", href: "/static/replay.css" });
    document.head.append(style);
    document.body.append(Object.assign(document.createElement("footer"), { id: "player", innerHTML: BAR }));
    const acts = {
      before: ["The event before", () => this.event(-1)], back: ["One picture back", () => this.step(-1)], play: ["Play", () => this.toggle()],
      on: ["One picture on", () => this.step(1)], after: ["The next event", () => this.event(1)],
    };
    for (const [id, [label, act]] of Object.entries(acts)) this.button(id, label, act);
    by("rate").append(...SPEEDS.map((times) => new Option(rateOf(times), times)));
    by("rate").addEventListener("change", () => {
      this.ask({ do: "speed", times: Number(by("rate").value) });
      by("rate").blur();
    });
    this.keys = this.keysOf(help);
    this.pointing();
    document.querySelector("#help b").textContent = "Keys of the recording";
    document.querySelector("#help dl").innerHTML = HELP.map(([key, what]) => `<div><dt><kbd>${key}</kbd></dt><dd>${what}</dd></div>`).join("");
  }

  get isStill() {
    return !this.head.playing;
  }

  // -- what comes in ----------------------------------------------------------------------------------------

  heard(message) {
    if (message.type === "timeline") this.drawLine(message);
    else if (message.type === "playhead") this.drawHead(message);
  }

  drawLine(timeline) {
    this.timeline = timeline;
    const share = (t_s) => `${(100 * t_s) / (timeline.span_s || 1)}%`;
    by("stretches").replaceChildren(...timeline.stretches.map(({ begin_s, end_s, state }) => {
      const node = document.createElement("i");
      node.className = state.toLowerCase().replace(/\W+/g, "-");
      Object.assign(node.style, { left: share(begin_s), width: share(end_s - begin_s) });
      return node;
    }));
    const losses = timeline.stretches.filter(({ state }, at) => LOST.includes(state) && !LOST.includes(timeline.stretches[at - 1]?.state));
    const marks = [...timeline.events.filter(({ kind }) => kind !== "state"), ...losses.map(({ begin_s }) => ({ t_s: begin_s, kind: "loss" }))];
    by("marks").replaceChildren(...marks.map(({ t_s, kind }) => {
      const node = Object.assign(document.createElement("i"), { className: kind });
      node.style.left = share(t_s);
      return node;
    }));
    this.events = [];
    for (const { t_s } of timeline.events) {
      if (this.events.length && t_s - this.events.at(-1).begin_s < EVENT_S) this.events.at(-1).end_s = t_s;
      else this.events.push({ begin_s: t_s, end_s: t_s });
    }
    by("timeline").setAttribute("aria-valuemax", timeline.span_s.toFixed(1));
    text("span", `/ ${clock(timeline.span_s)}`);
  }

  drawHead(head) {
    const onwards_s = head.t_s - (this.head.t_s ?? head.t_s);
    if (onwards_s < 0 || onwards_s > 1 + head.speed) by("says").replaceChildren(); // said at another time
    this.head = head;
    const isPlaying = String(head.playing);
    if (by("play").dataset.playing !== isPlaying) {
      by("play").dataset.playing = isPlaying;
      by("play").setAttribute("aria-label", head.playing ? "Stand still" : "Play");
      by("play").querySelector("path").setAttribute("d", FORMS[head.playing ? "pause" : "play"]);
    }
    if (document.activeElement !== by("rate")) this.drawRate(head.speed);
    text("day", head.unix_s === null ? "" : new Date(head.unix_s * 1000).toLocaleTimeString([], { hour12: false }));
    text("number", head.frame === null ? "" : `picture ${head.frame}`);
    if (this.wanted_s === null && !this.isAsking) this.drawAt(head.t_s);
  }

  drawRate(speed) {
    const rate = by("rate");
    if (![...rate.options].some(({ value }) => Number(value) === speed)) rate.append(new Option(rateOf(speed), speed));
    rate.value = String(speed);
  }

  drawAt(t_s) {
    text("at", clock(t_s));
    by("head").style.left = `${(100 * t_s) / (this.timeline.span_s || 1)}%`;
    by("timeline").setAttribute("aria-valuenow", t_s.toFixed(1));
    const lately = this.timeline.events.findLast((event) => event.t_s <= t_s + 0.05);
    text("lately", lately ? `${clock(lately.t_s)} ${lately.text}` : "");
  }

  // -- what is asked ----------------------------------------------------------------------------------------

  async ask(message) {
    const answer = await this.link.ask(message);
    if (!answer.ok) say(answer.text, "alarm");
  }

  toggle() {
    this.ask({ do: "play", on: !this.head.playing });
  }

  step(by) {
    this.ask({ do: "frames", by });
  }

  /** Only the newest place counts: a drag asks for many. */
  async seek(t_s) {
    this.wanted_s = Math.max(0, Math.min(t_s, this.timeline.span_s));
    this.drawAt(this.wanted_s);
    if (this.isAsking) return;
    this.isAsking = true;
    while (this.wanted_s !== null) {
      const to_s = this.wanted_s;
      this.wanted_s = null;
      await this.ask({ do: "seek", t_s: to_s });
      await new Promise((done) => setTimeout(done, SEEK_MS));
    }
    this.isAsking = false;
  }

  by_s(seconds) {
    this.seek((this.wanted_s ?? this.head.t_s) + seconds);
  }

  event(way) {
    const here_s = this.wanted_s ?? this.head.t_s;
    const found = way > 0 ? this.events.find(({ end_s }) => end_s > here_s + 0.1) : this.events.findLast(({ end_s }) => end_s < here_s - EVENT_S);
    if (found) this.seek(found.end_s + 0.001); // times are rounded: it has happened by then
    else say(way > 0 ? "no event after this" : "no event before this");
  }

  faster(way) {
    const at = SPEEDS.findLastIndex((times) => times <= this.head.speed);
    this.ask({ do: "speed", times: SPEEDS[Math.max(0, Math.min(at + way, SPEEDS.length - 1))] });
  }

  // -- keys and pointer -------------------------------------------------------------------------------------

  keysOf(help) {
    return {
      " ": () => this.toggle(), ",": () => this.step(-1), ".": () => this.step(1), p: () => this.event(-1), n: () => this.event(1),
      "-": () => this.faster(-1), "+": () => this.faster(1), "=": () => this.faster(1), home: () => this.seek(0), end: () => this.seek(this.timeline.span_s),
      arrowleft: (far) => this.by_s(far ? -6 * STEP_S : -STEP_S), arrowright: (far) => this.by_s(far ? 6 * STEP_S : STEP_S), h: help, "?": help,
    };
  }

  /** All keys are its own: a recording has nothing to abort. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select")) return true;
    const act = this.keys[event.key.toLowerCase()];
    if (!act) return true;
    event.preventDefault();
    if (!event.repeat || event.key.startsWith("Arrow") || ",.".includes(event.key)) act(event.shiftKey);
    return true;
  }

  button(id, label, act) {
    const node = Object.assign(document.createElement("button"), { id, type: "button" });
    node.setAttribute("aria-label", label);
    node.innerHTML = `<svg viewBox="0 0 24 24"><path d="${FORMS[id]}"/></svg>`;
    node.addEventListener("click", () => {
      node.blur(); // keys are for the page
      act();
    });
    by("buttons").append(node);
  }

  pointing() {
    const line = by("timeline");
    const timeAt = ({ clientX }) => {
      const { left, width } = line.getBoundingClientRect();
      return (Math.max(0, Math.min(clientX - left, width)) / width) * this.timeline.span_s;
    };
    const peek = (event) => {
      const t_s = timeAt(event);
      const state = this.timeline.stretches.find(({ begin_s, end_s }) => t_s >= begin_s && t_s < end_s)?.state ?? "";
      text("peek", `${clock(t_s)} ${state}`);
      by("peek").hidden = false;
      by("peek").style.left = `${Math.max(8, Math.min(92, (100 * t_s) / (this.timeline.span_s || 1)))}%`;
    };
    line.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      line.setPointerCapture(event.pointerId);
      peek(event);
      this.seek(timeAt(event));
    });
    line.addEventListener("pointermove", (event) => {
      peek(event);
      if (line.hasPointerCapture(event.pointerId)) this.seek(timeAt(event));
    });
    for (const kind of ["pointerleave", "pointerup", "pointercancel"]) line.addEventListener(kind, () => { by("peek").hidden = true; });
    line.addEventListener("focus", () => line.blur()); // its keys are the page's
  }
}
