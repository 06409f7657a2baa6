// Abort: over the WebSocket, and by POST where that is down or does not answer; again and again until it is answered.

const PATIENCE_MS = 300, AGAIN_MS = 400, POST_MS = 1500, SHOWN_MS = 4000;

export class Abort {
  /** show(phase, text): "idle", "sending", "done" or "failed". */
  constructor(link, show) {
    this.link = link;
    this.show = show;
    this.busy = false;
  }

  async press() {
    if (this.busy) return;
    this.busy = true;
    clearTimeout(this.rest);
    this.show("sending", "sending …");
    const answer = await this.untilAnswered();
    this.busy = false;
    this.show(answer.ok ? "done" : "failed", answer.text);
    this.rest = setTimeout(() => this.show("idle", ""), SHOWN_MS);
  }

  async untilAnswered() {
    const bySocket = this.link.isOpen ? this.link.ask({ do: "abort" }) : null;
    let answered = null;
    bySocket?.then((answer) => { if (!answer.lost) answered = answer; });
    if (bySocket) await Promise.race([bySocket, pause(PATIENCE_MS)]);
    for (let tries = 1; !answered; tries++) {
      const posted = await post();
      answered ??= posted;
      if (answered) break;
      this.show("sending", `NO ANSWER, try ${tries + 1} …`);
      await pause(AGAIN_MS);
    }
    return answered;
  }
}

/** Null: nobody answered. */
async function post() {
  try {
    const response = await fetch("/abort", { method: "POST", cache: "no-store", signal: AbortSignal.timeout(POST_MS) });
    if (response.ok || response.status === 409) return await response.json();
    if (response.status >= 500 && response.status !== 503) return null;
    return { ok: false, text: (await response.text()).slice(0, 80) || `refused (${response.status})` };
  } catch {
    return null;
  }
}

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
