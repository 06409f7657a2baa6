// Box or point on the picture, by mouse, pen or finger.

const LEAST_PX = 8; // of the screen: less is a click
const LEAST_SIDE_PX = 10; // of the picture: the tracker takes no less

/** overlay: where the picture is. hooks: shownSeq(), box(box, seq), point(x, y, seq), drawing(box or null), tooSmall(). */
export function pointing(canvas, overlay, hooks) {
  let press = null;

  const boxTo = (event) => {
    const ends = [press.at, overlay.toPicture(event.clientX, event.clientY)];
    const { width, height } = hooks.size();
    const xs = ends.map(([x]) => clamp(x, width)), ys = ends.map(([, y]) => clamp(y, height));
    return [Math.min(...xs), Math.min(...ys), Math.abs(xs[0] - xs[1]), Math.abs(ys[0] - ys[1])];
  };
  const isDrag = (event) => Math.hypot(event.clientX - press.x, event.clientY - press.y) >= LEAST_PX;
  const cancel = () => {
    press = null;
    hooks.drawing(null);
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (press !== null) return cancel(); // a second finger: not meant
    if (event.button !== 0 || !overlay.place || hooks.shownSeq() === null) return;
    canvas.setPointerCapture(event.pointerId);
    const at = overlay.toPicture(event.clientX, event.clientY);
    press = { id: event.pointerId, x: event.clientX, y: event.clientY, at, seq: hooks.shownSeq() };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (press?.id === event.pointerId) hooks.drawing(isDrag(event) ? boxTo(event) : null);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (press?.id !== event.pointerId) return;
    const { at, seq } = press;
    const drawn = isDrag(event) ? boxTo(event) : null;
    cancel();
    // A click means what was there when the finger came down; a box was fitted to what was there when it was let go.
    if (drawn === null) return isInside(at, hooks.size()) && hooks.point(at[0], at[1], seq);
    if (Math.min(drawn[2], drawn[3]) < LEAST_SIDE_PX) return hooks.tooSmall();
    hooks.box(drawn, hooks.shownSeq());
  });
  canvas.addEventListener("pointercancel", cancel);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  return { cancel };
}

const clamp = (value, most) => Math.max(0, Math.min(value, most));
const isInside = ([x, y], { width, height }) => x >= 0 && y >= 0 && x < width && y < height;
