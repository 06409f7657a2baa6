// Pictures and what is known of them come on two ways; they are shown together or not at all.

const KEPT = 150, WAIT_MS = 120, NEAR = 3;

export class Pictures {
  /** shown({seq, image, width, height, frame}): a picture and its JSON, null where none came. seen(seq): decoded. */
  constructor(shown, seen) {
    Object.assign(this, { shown, seen });
    this.frames = new Map();
    this.newestSeq = -1;
    this.pending = null;
  }

  forget() {
    this.frames.clear();
    this.newestSeq = -1;
    this.drop(this.pending);
    this.pending = null;
  }

  frameOf(seq) {
    return this.frames.get(seq) ?? null;
  }

  /** On a slow link some are left out: then one that is at most a few frames off; null: none. */
  nearest(seq) {
    for (let off = 0; off <= NEAR; off++) {
      const found = this.frames.get(seq - off) ?? this.frames.get(seq + off);
      if (found) return found;
    }
    return null;
  }

  heard(frame) {
    this.frames.set(frame.frame, frame);
    if (this.frames.size > KEPT) this.frames.delete(this.frames.keys().next().value);
    if (this.pending?.seq === frame.frame) this.show(frame);
  }

  async arrived({ seq, width, height, jpeg }) {
    let image = null;
    try {
      image = await createImageBitmap(jpeg);
    } catch {
      // a damaged picture: the next one comes
    }
    this.seen(seq);
    if (image === null) return;
    if (seq <= this.newestSeq) return image.close();
    this.newestSeq = seq;
    this.drop(this.pending);
    this.pending = { seq, width, height, image };
    const frame = this.frameOf(seq);
    if (frame) this.show(frame);
    else setTimeout(() => this.pending?.seq === seq && this.show(this.nearest(seq)), WAIT_MS);
  }

  show(frame) {
    const picture = this.pending;
    this.pending = null;
    this.shown({ ...picture, frame });
  }

  drop(picture) {
    picture?.image.close();
  }
}
