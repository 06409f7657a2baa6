// The drawer with what moves the vehicle without a target, and the help. ABORT stays above both.

import { Hold, onHeld } from "./hold.js";
import { by, say } from "./panels.js";

const PANELS = { drawer: "orders", help: "keys" }; // each with its button

/** order(message) asks. Returns toggle(name), close(), void(why). */
export function drawer({ order }) {
  const hold = new Hold((done) => pressed?.style.setProperty("--done", String(done ?? 0)));
  let pressed = null;

  const show = (name) => {
    hold.end();
    if (document.activeElement?.closest("#drawer, #help")) document.activeElement.blur();
    for (const [id, button] of Object.entries(PANELS)) {
      by(id).hidden = id !== name;
      by(button).setAttribute("aria-expanded", String(id === name));
    }
  };
  /** The vehicle moves: from now on the picture is what counts. */
  const given = (message) => {
    if (message.do !== "accept") show(null);
    order(message);
  };
  const number = (id) => (by(id).value.trim() && by(id).validity.valid ? Number(by(id).value) : null);
  const messages = {
    hold: () => ({ do: "hold" }),
    land: () => ({ do: "land" }),
    return: () => ({ do: "return" }),
    takeoff: () => (by("takeoff-height").validity.valid ? { do: "takeoff", height_m: number("takeoff-height") } : "a height from 2 to 120 m"),
    accept: () => (by("accept-name").value.trim() ? { do: "accept", name: by("accept-name").value.trim().toUpperCase() } : "the name of a parameter"),
  };
  for (const button of document.querySelectorAll("button.hold")) {
    const press = () => {
      const message = messages[button.dataset.do]();
      if (typeof message === "string") return say(`expected ${message}`, "alarm");
      pressed = button;
      hold.begin({ done: () => given(message), left: (why) => why && say(`not done: ${why}`, "alarm") });
    };
    onHeld(button, press, () => hold.end());
    button.type = "button";
  }
  const form = (id, value, unset, name) => {
    by(id).addEventListener("submit", (event) => {
      event.preventDefault();
      const m = number(value);
      if (m === null) return say(`expected a ${name} in metres`, "alarm");
      order({ do: name, m });
      by(value).blur();
    });
    by(unset).addEventListener("click", () => order({ do: name, m: null }));
  };
  form("standoff-form", "standoff-value", "standoff-now", "standoff");
  form("distance-form", "distance-value", "distance-auto", "distance");
  by("accept-form").addEventListener("submit", (event) => event.preventDefault());
  for (const button of document.querySelectorAll("button.close")) button.addEventListener("click", () => show(null));

  return {
    toggle: (name) => show(by(name).hidden ? name : null),
    close: () => show(null),
    void: (why) => hold.end(why),
  };
}
