// The WebSocket: answers by id, reconnection with back-off. What is open is all it knows: nothing is kept for later.

const HEADER_BYTES = 16;
const SILENT_MS = 4000; // so long unheard, the connection is taken for dead
const FIRST_MS = 250, MOST_MS = 3000;

export class Link {
  /** heard(message), pictured({seq, width, height, jpeg}), changed(isOpen) */
  constructor({ heard, pictured, changed }) {
    Object.assign(this, { heard, pictured, changed });
    this.socket = null;
    this.waiting = new Map();
    this.nextId = 1;
    this.backOffMs = FIRST_MS;
    this.heardAt = performance.now();
    this.refused = false;
    this.reason = ""; // why the station closed it
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Milliseconds since the last message. */
  get silentMs() {
    return performance.now() - this.heardAt;
  }

  start() {
    this.connect();
    setInterval(() => this.isOpen && this.silentMs > SILENT_MS && this.lost(this.socket), 500);
    addEventListener("online", () => this.isOpen || this.connect());
  }

  connect() {
    clearTimeout(this.timer);
    if (this.socket) this.lost(this.socket, false);
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.heardAt = performance.now();
      this.changed(true);
    };
    socket.onclose = ({ reason }) => {
      if (socket === this.socket) this.reason = reason;
      this.lost(socket);
    };
    socket.onmessage = ({ data }) => socket === this.socket && this.read(data);
    this.socket = socket;
  }

  read(data) {
    this.heardAt = performance.now();
    this.backOffMs = FIRST_MS;
    if (typeof data !== "string") {
      const [seq, width, height] = new Uint32Array(data, 0, 3);
      this.pictured({ seq, width, height, jpeg: new Blob([new Uint8Array(data, HEADER_BYTES)], { type: "image/jpeg" }) });
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "answer") {
      this.waiting.get(message.id)?.(message);
      this.waiting.delete(message.id);
    } else this.heard(message);
  }

  lost(socket, again = true) {
    if (socket !== this.socket) return;
    this.socket = null;
    socket.close();
    for (const answer of this.waiting.values()) answer({ ok: false, text: "the connection was lost", reasons: [], lost: true });
    this.waiting.clear();
    this.changed(false);
    if (!again) return;
    this.timer = setTimeout(() => this.connect(), this.backOffMs * (0.8 + 0.4 * Math.random()));
    this.backOffMs = Math.min(MOST_MS, this.backOffMs * 2);
    this.askWhetherKnown();
  }

  /** A browser whose session has ended is told nothing by a WebSocket that fails. */
  async askWhetherKnown() {
    try {
      this.refused = (await fetch("/status.json", { cache: "no-store" })).status === 401;
    } catch {
      this.refused = false;
    }
  }

  /** Say something that needs no answer; false: nobody hears. */
  tell(message) {
    if (!this.isOpen) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /** The answer: {ok, text, reasons}; never rejects. */
  ask(message) {
    const id = this.nextId++;
    if (!this.tell({ ...message, id })) return Promise.resolve({ ok: false, text: "no connection", reasons: [], lost: true });
    return new Promise((resolve) => this.waiting.set(id, resolve));
  }
}
