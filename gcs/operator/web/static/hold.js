// What must be meant is held for a second. Anything that comes between makes it void, and it begins again with a new press.

export const HOLD_MS = 1000;

export class Hold {
  /** progress(fraction or null), at most every frame. */
  constructor(progress) {
    this.progress = progress;
    this.current = null;
  }

  get isRunning() {
    return this.current !== null;
  }

  /** begun(): a promise of {ok, text}, what must be true before the second counts, or null. done(), left(why). */
  begin({ begun = null, done, left = () => {} }) {
    this.end("another one");
    const hold = { left, startedAt: performance.now(), ready: begun === null };
    this.current = hold;
    this.tick(hold);
    const finish = () => {
      if (this.current !== hold) return;
      this.current = null;
      this.progress(null);
      done();
    };
    if (begun === null) hold.timer = setTimeout(finish, HOLD_MS);
    // The station counts the second on its own clock from when it heard of the press: so do we, from when it said so.
    else begun().then((answer) => {
      if (this.current !== hold) return;
      if (!answer.ok) return this.end(answer.text);
      hold.timer = setTimeout(finish, Math.max(HOLD_MS - 80, HOLD_MS - (performance.now() - hold.startedAt)));
    });
  }

  end(why = "") {
    const hold = this.current;
    if (hold === null) return;
    this.current = null;
    clearTimeout(hold.timer);
    this.progress(null);
    hold.left(why);
  }

  tick(hold) {
    if (this.current !== hold) return;
    this.progress(Math.min(1, (performance.now() - hold.startedAt) / HOLD_MS));
    requestAnimationFrame(() => this.tick(hold));
  }
}

/** Press and let go of a button, by mouse, finger or pen. */
export function onHeld(button, press, leave) {
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    press();
  });
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(kind, () => leave());
  button.addEventListener("pointermove", (event) => {
    const edge = button.getBoundingClientRect();
    const inside = event.clientX >= edge.left && event.clientX <= edge.right && event.clientY >= edge.top && event.clientY <= edge.bottom;
    if (!inside) leave();
  });
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}
