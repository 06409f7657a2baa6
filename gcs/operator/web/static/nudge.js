// Keys move and resize the selected box: what was pressed is gathered, and selected anew at most four times a second.

const EVERY_MS = 250, GIVE_UP_MS = 700, LEAST_SIDE_PX = 10;

export class Nudge {
  /** shown(): {frame, seq} now on the screen; size(): of the picture; select(box, seq). */
  constructor(shown, size, select) {
    Object.assign(this, { shown, size, select });
    this.clear();
  }

  clear() {
    this.by = null;
    clearTimeout(this.timer);
    this.timer = null;
    this.sent = null;
  }

  /** dx, dy in px of the picture; grow: factor. */
  add(dx, dy, grow = 1) {
    const { frame } = this.shown();
    if (!frame?.box || !frame.visible) return;
    const by = this.by ?? { dx: 0, dy: 0, grow: 1 };
    this.by = { dx: by.dx + dx, dy: by.dy + dy, grow: by.grow * grow };
    this.timer ??= setTimeout(() => this.flush(), this.sent ? EVERY_MS : 60);
  }

  /** The box as it will be selected; null: nothing is pending. */
  get box() {
    const { frame } = this.shown();
    if (!this.by || !frame?.box) return null;
    const [x, y, w, h] = frame.box;
    const { width, height } = this.size();
    const nw = Math.min(Math.max(w * this.by.grow, LEAST_SIDE_PX), width), nh = Math.min(Math.max(h * this.by.grow, LEAST_SIDE_PX), height);
    const left = x + w / 2 + this.by.dx - nw / 2, top = y + h / 2 + this.by.dy - nh / 2;
    return [Math.min(Math.max(left, 0), width - nw), Math.min(Math.max(top, 0), height - nh), nw, nh];
  }

  flush() {
    this.timer = null;
    const { frame, seq } = this.shown();
    const { box } = this;
    if (box === null) return this.clear();
    // What was sent last must be on the screen before more is added to it.
    const waiting = this.sent && frame.selection === this.sent.selection && performance.now() - this.sent.at < GIVE_UP_MS;
    if (waiting) {
      this.timer = setTimeout(() => this.flush(), EVERY_MS);
      return;
    }
    this.sent = { selection: frame.selection, at: performance.now() };
    this.by = null;
    this.select(box, seq);
  }
}
