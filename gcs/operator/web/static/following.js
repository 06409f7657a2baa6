// The confirmation: held for a second by key or button, void as soon as anything changes under it.

import { Hold, onHeld } from "./hold.js";
import { by, isTouch, say, showRefusals, text } from "./panels.js";

const ENGAGED = ["following", "coasting", "lost, holding"];
const LEAST_M = 2;
const ENDED = ["released", "taken over"];

export class Following {
  constructor({ link, order, page }) {
    Object.assign(this, { link, order, page });
    this.hold = new Hold((done) => this.progress(done));
    this.basis = "";
    this.wantedStandoff_m = null; // for the next confirmation; the station's status tells only the one that is held
    onHeld(by("follow"), () => this.press(), () => this.leave());
  }

  /** Everything that keeps it from being pressed; null: there is nothing to confirm. */
  get refusals() {
    const { status } = this.page();
    if (!status || status.state !== "selected" || status.engaging) return null;
    const other = status.controller && !status.in_control ? [`${status.controller} is in control`] : [];
    return [...other, ...status.refusals];
  }

  press() {
    const { refusals } = this;
    if (refusals === null) return;
    if (refusals.length || !this.link.isOpen) {
      const more = refusals.length > 1 ? `, and ${refusals.length - 1} more` : "";
      say(refusals.length ? `not following: ${refusals[0]}${more}` : "no connection", "alarm");
      by("refusals").classList.remove("flash");
      requestAnimationFrame(() => by("refusals").classList.add("flash"));
      return;
    }
    this.basis = this.basisNow();
    this.hold.begin({
      begun: () => this.link.ask({ do: "hold_begin" }),
      done: () => this.order({ do: "confirm" }),
      left: (why) => {
        this.link.tell({ do: "hold_end" });
        if (why) say(`not confirmed: ${why}`, "alarm");
      },
    });
  }

  leave() {
    this.hold.end();
  }

  void(why) {
    this.hold.end(why);
  }

  /** Farther by so much; nearer where it is negative. */
  step(by_m) {
    const { status } = this.page();
    if (!status) return;
    if (status.engaging || ENGAGED.includes(status.state)) return void this.order({ do: "step", m: by_m });
    const from_m = status.standoff_m ?? this.wantedStandoff_m ?? status.distance_m;
    if (from_m === null) return say("the distance is not known: set a standoff under Flight");
    this.wantedStandoff_m = Math.max(LEAST_M, Math.round(from_m + by_m));
    this.order({ do: "standoff", m: this.wantedStandoff_m });
  }

  /** Whatever differs from when the button was pressed was not meant. */
  basisNow() {
    const { status } = this.page();
    return `${status?.selection} ${status?.state}`;
  }

  update() {
    if (!this.hold.isRunning) return;
    const { refusals } = this;
    if (refusals === null || this.basis !== this.basisNow()) this.void("the target changed");
    else if (refusals.length) this.void(refusals[0]);
  }

  progress(done) {
    by("ring").hidden = done === null;
    by("follow").style.setProperty("--done", String(done ?? 0));
    by("ring-fill").style.strokeDashoffset = String(1 - (done ?? 0));
    text("ring-text", done === null ? "" : "FOLLOW");
  }

  show(isLost) {
    const { status } = this.page();
    const { refusals } = this;
    showRefusals(isLost || refusals === null ? [] : refusals);
    const isEnded = !isLost && ENDED.includes(status?.state) && !status.engaging;
    by("ack").hidden = !isEnded;
    by("follow").hidden = isEnded;
    by("follow").disabled = isLost || refusals === null || refusals.length > 0;
    const isEngaged = status && (status.engaging || ENGAGED.includes(status.state));
    by("follow").dataset.engaged = String(Boolean(isEngaged));
    text("follow-hint", this.hint(isLost, status, isEngaged, refusals));
  }

  hint(isLost, status, isEngaged, refusals) {
    if (isLost || !status) return "no connection";
    if (isEngaged) return status.engaging ? "engaging …" : "under way";
    if (refusals === null) return "draw a box first";
    return refusals.length ? `not now: ${refusals.length} reason${refusals.length > 1 ? "s" : ""}` : isTouch ? "hold for a second" : "hold 1 s · F";
  }
}
