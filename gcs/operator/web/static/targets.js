// The numbered boxes: asked for while they are shown, and once for "track what is nearest the centre".

import { by, say } from "./panels.js";

const TRACK_WAIT_MS = 2500;

export class Targets {
  constructor({ link, order, size, shown, redraw }) {
    Object.assign(this, { link, order, size, shown, redraw });
    this.found = [];
    this.isOn = false;
    this.trackTimer = null;
  }

  /** What is drawn. */
  get boxes() {
    return this.isOn ? this.found : [];
  }

  /** A new connection does not know what was asked for on the last one. */
  welcomed() {
    this.stop();
    if (this.isOn) this.ask(true);
  }

  stop() {
    clearTimeout(this.trackTimer);
    this.trackTimer = null;
    this.found = [];
  }

  ask(on) {
    this.link.tell({ do: "candidates", on });
  }

  toggle() {
    this.isOn = !this.isOn;
    this.found = [];
    by("boxes").setAttribute("aria-pressed", String(this.isOn));
    this.ask(this.isOn);
    if (this.isOn) say("looking for what moves");
    this.redraw();
  }

  heard(boxes) {
    this.found = boxes;
    if (this.trackTimer !== null && boxes.length) this.trackNearest();
    this.redraw();
  }

  /** The box that is tracked is taken anew where there is one; else what is nearest the centre. */
  track() {
    const frame = this.shown()?.frame;
    if (frame?.box && frame.visible) return void this.order({ do: "select", box: frame.box, frame: frame.frame });
    if (this.trackTimer !== null) return;
    if (this.boxes.length) return this.trackNearest();
    if (!this.isOn) this.ask(true);
    this.trackTimer = setTimeout(() => {
      this.endTrack();
      say("nothing found to track: draw a box");
    }, TRACK_WAIT_MS);
  }

  trackNearest() {
    const { width, height } = this.size();
    const away = ({ box: [x, y, w, h] }) => Math.hypot(x + w / 2 - width / 2, y + h / 2 - height / 2);
    const nearest = this.found.reduce((best, each) => (away(each) < away(best) ? each : best));
    this.pick(nearest.number);
    this.endTrack();
  }

  endTrack() {
    clearTimeout(this.trackTimer);
    this.trackTimer = null;
    if (!this.isOn) this.ask(false);
  }

  pick(number) {
    if (!this.isOn && this.trackTimer === null) return this.toggle(); // which is which must be seen first
    this.order({ do: "candidate", number });
  }

  /** The number of the smallest box that is shown at this point (px of the picture); null: none. */
  at(px, py) {
    const hit = this.boxes.filter(({ box: [x, y, w, h] }) => px >= x && px <= x + w && py >= y && py <= y + h);
    return hit.length ? hit.reduce((best, each) => (each.box[2] * each.box[3] < best.box[2] * best.box[3] ? each : best)).number : null;
  }
}
