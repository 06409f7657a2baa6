// WebRTC where it is offered and switched on; single pictures before, after, and where it fails.

import { by, say } from "./panels.js";

const FIRST_MS = 8000;

/** shown(seq, image) for each presented frame. Returns toggle() and stop(). */
export function webrtc({ link, isOffered, shown }) {
  const video = by("live");
  let module = null, turn = 0;

  const stop = () => {
    turn += 1;
    if (module === null) return;
    module.stop();
    module = null;
    by("webrtc").setAttribute("aria-pressed", "false");
    link.tell({ do: "pictures", on: true });
  };
  const fail = (why) => {
    stop();
    say(`WebRTC: ${why}; single pictures instead`, "alarm");
  };
  const start = async () => {
    const mine = ++turn;
    let timer = null;
    try {
      module = await import("./webrtc.js");
      by("webrtc").setAttribute("aria-pressed", "true");
      timer = setTimeout(() => mine === turn && fail("no picture came"), FIRST_MS);
      await module.start(video, (seq, image) => {
        if (mine !== turn) return image.close?.();
        if (timer !== null) link.tell({ do: "pictures", on: false }); // only now: nothing goes dark in between
        clearTimeout(timer);
        timer = null;
        shown(seq, image);
      }, (why) => mine === turn && fail(why));
    } catch (error) {
      clearTimeout(timer);
      if (mine === turn) fail(error.message);
    }
  };
  return {
    toggle: () => {
      if (module !== null) return stop();
      if (isOffered()) start();
      else say("the station offers no WebRTC");
    },
    stop,
  };
}
