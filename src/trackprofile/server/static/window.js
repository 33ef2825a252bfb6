// The stretch of line that is looked at: wheel, drag, pinch, keys and buttons move and narrow it.

export const LEAST = 10; // m

/** A stretch within a whole, at least `LEAST` long. */
export function held([from, to], whole) {
  const length = Math.max(Math.min(LEAST, whole[1] - whole[0]), Math.min(to - from, whole[1] - whole[0]));
  const start = Math.max(whole[0], Math.min((from + to - length) / 2, whole[1] - length));
  return [start, start + length];
}

export function zoomed(view, factor, centre, whole) {
  return held([centre - (centre - view[0]) * factor, centre + (view[1] - centre) * factor], whole);
}

/** Keys and what they do to a view. */
export function moved(key, view, whole) {
  const length = view[1] - view[0], middle = (view[0] + view[1]) / 2;
  switch (key) {
    case "ArrowLeft": return held([view[0] - length / 4, view[1] - length / 4], whole);
    case "ArrowRight": return held([view[0] + length / 4, view[1] + length / 4], whole);
    case "PageUp": return held([view[0] - length, view[1] - length], whole);
    case "PageDown": return held([view[0] + length, view[1] + length], whole);
    case "+": case "=": return zoomed(view, 0.5, middle, whole);
    case "-": return zoomed(view, 2, middle, whole);
    case "Home": return whole.slice();
    default: return null;
  }
}

/**
 * Lets a canvas be moved and zoomed. `port` has view(), whole(), box() in CSS pixels, show(view) while it moves,
 * point(place or null) where the pointer is, and pick(place) for a click.
 */
export function handle(canvas, port) {
  const fingers = new Map();
  let travelled = 0, before = null;
  const placeOf = (clientX) => {
    const edge = canvas.getBoundingClientRect(), box = port.box(), view = port.view();
    return view[0] + ((clientX - edge.left - box.left) / box.width) * (view[1] - view[0]);
  };
  canvas.addEventListener("wheel", (event) => {
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      const view = port.view(), by = ((event.deltaX || event.deltaY) / port.box().width) * (view[1] - view[0]);
      port.show(held([view[0] + by, view[1] + by], port.whole()));
    } else port.show(zoomed(port.view(), Math.exp(event.deltaY * 0.0015), placeOf(event.clientX), port.whole()));
    event.preventDefault();
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, event.clientX);
    before = null;
    if (fingers.size === 1) travelled = 0;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return port.point(placeOf(event.clientX));
    const by = event.clientX - fingers.get(event.pointerId);
    fingers.set(event.pointerId, event.clientX);
    travelled += Math.abs(by);
    const view = port.view(), box = port.box();
    if (fingers.size === 1) {
      if (travelled < 4) return;
      const shift = (-by / box.width) * (view[1] - view[0]);
      return port.show(held([view[0] + shift, view[1] + shift], port.whole()));
    }
    const [a, b] = fingers.values(), now = { apart: Math.max(20, Math.abs(a - b)), middle: (a + b) / 2 };
    if (before) {
      const shift = ((before.middle - now.middle) / box.width) * (view[1] - view[0]);
      port.show(zoomed([view[0] + shift, view[1] + shift], before.apart / now.apart, placeOf(now.middle), port.whole()));
    }
    before = now;
  });
  const lift = (event) => {
    if (!fingers.delete(event.pointerId)) return;
    before = null;
    if (event.type === "pointerup" && !fingers.size && travelled < 4) port.pick(placeOf(event.clientX));
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointerleave", () => port.point(null));
  canvas.addEventListener("dblclick", () => port.show(port.whole().slice()));
}
