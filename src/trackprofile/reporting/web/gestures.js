// Wheel, drag, pinch, click and double click on a chart change the stretch that is shown.

import { clamped, shifted, zoomed } from "./view.js";

const CLICK_PX = 4;

/**
 * Attaches the gestures to an element that covers the plotting area. `port` has view(), whole(), show(view) while it
 * moves, point(distance or null) where the pointer is, and pick(distance) for a click.
 */
export function addGestures(element, port) {
  const pointers = new Map();
  let travelled = 0, previous = null;
  const width = () => element.getBoundingClientRect().width;
  const length = () => port.view()[1] - port.view()[0];
  const distanceAt = (clientX) => {
    const edge = element.getBoundingClientRect();
    return port.view()[0] + ((clientX - edge.left) / edge.width) * length();
  };
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    const sideways = event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY);
    if (sideways) port.show(shifted(port.view(), ((event.deltaX || event.deltaY) / width()) * length(), port.whole()));
    else port.show(zoomed(port.view(), Math.exp(event.deltaY * 0.0015), distanceAt(event.clientX), port.whole()));
  }, { passive: false });
  element.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, event.clientX);
    previous = null;
    if (pointers.size === 1) travelled = 0;
    element.setPointerCapture(event.pointerId);
  });
  element.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return port.point(distanceAt(event.clientX));
    const by = event.clientX - pointers.get(event.pointerId);
    pointers.set(event.pointerId, event.clientX);
    travelled += Math.abs(by);
    if (pointers.size > 1) return pinch();
    if (travelled >= CLICK_PX) port.show(shifted(port.view(), (-by / width()) * length(), port.whole()));
  });
  function pinch() {
    const [a, b] = pointers.values(), now = { apart: Math.max(20, Math.abs(a - b)), middle: (a + b) / 2 };
    if (previous) {
      const moved = shifted(port.view(), ((previous.middle - now.middle) / width()) * length(), port.whole());
      port.show(zoomed(moved, previous.apart / now.apart, distanceAt(now.middle), port.whole()));
    }
    previous = now;
  }
  const lift = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    previous = null;
    if (event.type === "pointerup" && !pointers.size && travelled < CLICK_PX) port.pick(distanceAt(event.clientX));
  };
  element.addEventListener("pointerup", lift);
  element.addEventListener("pointercancel", lift);
  element.addEventListener("pointerleave", () => port.point(null));
  element.addEventListener("dblclick", () => port.show(clamped(port.whole(), port.whole())));
}
