// The picture and what is drawn on it. Bright lines over dark outlines stand out on any background.

export const TONES = { calm: "#ffffff", good: "#3dff7a", caution: "#ffb400", alarm: "#ff5046" };
const CYAN = "#3ce6ff", YELLOW = "#ffe94a", DARK = "rgba(0,0,0,0.8)";

/** Where a picture of this size lies in a stage of that size: {left, top, width, height, scale}, CSS px. */
export function fit(stage, picture) {
  const scale = Math.min(stage.width / picture.width, stage.height / picture.height);
  const width = picture.width * scale, height = picture.height * scale;
  return { left: (stage.width - width) / 2, top: (stage.height - height) / 2, width, height, scale };
}

export class Overlay {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.place = null;
  }

  /** Match the canvas to what it covers, in the screen's own pixels. */
  resize(picture) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const dpr = window.devicePixelRatio || 1;
    const w = Math.round(width * dpr), h = Math.round(height * dpr);
    if (this.canvas.width !== w || this.canvas.height !== h) Object.assign(this.canvas, { width: w, height: h });
    this.dpr = dpr;
    this.place = fit({ width, height }, picture);
  }

  /** view: {image, size, frame, tone, candidates, drawn, nudged} */
  draw(view) {
    this.resize(view.size);
    const { context: c, place, dpr } = this;
    c.setTransform(dpr, 0, 0, dpr, 0, 0);
    c.fillStyle = "#000";
    c.fillRect(0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    if (view.image) c.drawImage(view.image, place.left, place.top, place.width, place.height);
    const { frame } = view;
    for (const { number, box } of view.candidates) this.candidate(number, this.toScreen(box));
    if (frame?.predicted) this.brackets(this.toScreen(frame.predicted), CYAN);
    if (frame?.selection && !frame.visible && frame.predicted) this.tag("NOT SEEN", this.toScreen(frame.predicted), TONES.caution);
    if (frame?.box && frame.visible) this.box(this.toScreen(frame.box), TONES[view.tone] ?? TONES.calm);
    if (view.nudged) this.box(this.toScreen(view.nudged), YELLOW, [6, 4]);
    if (view.drawn) this.box(this.toScreen(view.drawn), YELLOW, [6, 4]);
  }

  toScreen([x, y, w, h]) {
    const { left, top, scale } = this.place;
    return { x: left + x * scale, y: top + y * scale, w: w * scale, h: h * scale };
  }

  /** Pixels of the full picture at a point of the window, which may lie outside of it. */
  toPicture(clientX, clientY) {
    const edge = this.canvas.getBoundingClientRect();
    const { left, top, scale } = this.place;
    return [(clientX - edge.left - left) / scale, (clientY - edge.top - top) / scale];
  }

  twice(colour, path, dash = []) {
    const { context: c } = this;
    c.setLineDash([]);
    for (const [style, width, dashes] of [[DARK, 5, []], [colour, 2.5, dash]]) {
      c.strokeStyle = style;
      c.lineWidth = width;
      c.setLineDash(dashes);
      c.beginPath();
      path(c);
      c.stroke();
    }
    c.setLineDash([]);
  }

  box({ x, y, w, h }, colour, dash) {
    this.twice(colour, (c) => c.rect(x, y, w, h), dash);
  }

  /** Four corners only, a little outside, so that it can never be taken for the tracker's own box. */
  brackets({ x, y, w, h }, colour) {
    const out = 4, arm = Math.max(7, Math.min(w, h) / 4);
    const corners = [[x - out, 1, y - out, 1], [x + w + out, -1, y - out, 1], [x - out, 1, y + h + out, -1], [x + w + out, -1, y + h + out, -1]];
    this.twice(colour, (c) => {
      for (const [cx, sx, cy, sy] of corners) {
        c.moveTo(cx + sx * arm, cy);
        c.lineTo(cx, cy);
        c.lineTo(cx, cy + sy * arm);
      }
    });
  }

  candidate(number, at) {
    this.twice("#ffffff", (c) => c.rect(at.x, at.y, at.w, at.h), [3, 3]);
    this.tag(String(number), at, "#ffffff");
  }

  tag(text, { x, y }, colour) {
    const { context: c } = this;
    c.font = "bold 15px system-ui, sans-serif";
    const width = c.measureText(text).width + 10;
    const top = y >= 26 ? y - 25 : y + 3;
    x = Math.max(2, Math.min(x, this.canvas.clientWidth - width));
    c.fillStyle = colour;
    c.fillRect(x - 2, top, width, 21);
    c.fillStyle = "#000";
    c.textBaseline = "middle";
    c.fillText(text, x + 3, top + 11);
  }
}
