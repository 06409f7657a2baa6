// The keyboard. Space and Esc abort from anywhere, whatever has the focus; the rest is for the page alone.

const NUDGE_PX = 2, FAR_PX = 12, GROW = 1.06;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** The letter as it stands on the key where the layout writes others. */
const letterOf = (event) => (event.key > "~" && event.code.startsWith("Key") ? event.code.slice(3) : event.key).toLowerCase();

/** acts: what the keys do; acts.held(true/false) for F; acts.replayed(event): a recording has taken it. */
export function keys(acts) {
  const isAbort = (event) => event.code === "Space" || event.key === "Escape";
  const letters = {
    t: acts.track, c: acts.candidates, x: acts.drop, delete: acts.drop, backspace: acts.drop, m: acts.mode, r: acts.record, d: acts.drawer,
    h: acts.help, "?": acts.help, v: acts.webrtc, enter: acts.ack, "[": acts.closer, "]": acts.farther,
    "+": () => acts.nudge(0, 0, GROW), "=": () => acts.nudge(0, 0, GROW), "-": () => acts.nudge(0, 0, 1 / GROW), _: () => acts.nudge(0, 0, 1 / GROW),
  };

  addEventListener("keydown", (event) => {
    if (acts.replayed(event)) return;
    if (isAbort(event)) {
      event.preventDefault(); // Space would press the button that has the focus
      event.stopImmediatePropagation();
      if (!event.repeat) acts.abort();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input")) return;
    const key = letterOf(event);
    if (key === "enter" && event.target.matches("button, a")) return;
    if (key === "f") {
      if (!event.repeat) acts.held(true);
    } else if (event.key in ARROWS) {
      const far = event.shiftKey ? FAR_PX : NUDGE_PX;
      acts.nudge(...ARROWS[event.key].map((way) => way * far), 1);
    } else if (/^[1-9]$/.test(key)) acts.pick(Number(key));
    else if (letters[key] && (!event.repeat || "+=-_".includes(key))) letters[key]();
    else return;
    event.preventDefault();
  }, true);

  addEventListener("keyup", (event) => {
    if (isAbort(event)) {
      event.preventDefault();
      event.stopImmediatePropagation();
    } else if (letterOf(event) === "f") acts.held(false);
  }, true);
}
