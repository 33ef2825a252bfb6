// The line as a bar: a lane per action, a mark per place, and the stretch that is looked at.

import { FAINT, INK, axisBelow, boxOf, fitting, line, prepared, scale, ticks } from "./plot.js";
import { mark } from "./strips.js";
import { ACTIONS, km, kmDigits } from "./words.js";

const LANE = 15;
export const HEIGHT = 4 * LANE + 24;

/** Draws the whole of a line; `bins` are {start_m, end_m, calls_for, places, peak_m}. */
export function drawSchematic(canvas, { whole, view, bins }) {
  const { pen, width, height } = prepared(canvas);
  const names = Math.max(...ACTIONS.map((one) => pen.measureText(one.short).width));
  const box = boxOf(width, height, { left: names + 14, right: 12, top: 2, bottom: 22 });
  const x = scale(whole, box.left, box.right), lane = box.height / ACTIONS.length;
  const { step, at } = ticks(whole, fitting(box));
  axisBelow(pen, box, x, at, (place) => km(place, kmDigits(step)), { least: box.left - 20, most: width });
  ACTIONS.forEach((action, i) => {
    const middle = box.top + (i + 0.5) * lane;
    pen.strokeStyle = FAINT;
    line(pen, box.left, middle, box.right, middle);
    pen.fillStyle = INK;
    pen.textAlign = "right";
    pen.fillText(action.short, box.left - 8, middle + 4);
    for (const one of bins) {
      if (one.calls_for === action.key) mark(pen, x(one.peak_m), middle, action.grade, action.colour, Math.min(4.5, lane / 2.6));
    }
  });
  if (view && (view[1] - view[0]) < 0.999 * (whole[1] - whole[0])) {
    pen.strokeStyle = "#0072B2";
    pen.fillStyle = "rgba(0,114,178,0.10)";
    pen.lineWidth = 2;
    const start = x(view[0]), wide = Math.max(4, x(view[1]) - start);
    pen.fillRect(start, box.top, wide, box.height);
    pen.strokeRect(start, box.top + 1, wide, box.height - 2);
  }
  return box;
}

/** Lets a click or drag on the bar choose where to look. */
export function pickOn(canvas, box, whole, go) {
  let pressed = false;
  const at = (event) => {
    const edge = canvas.getBoundingClientRect(), inner = box();
    const part = (event.clientX - edge.left - inner.left) / inner.width;
    const limits = whole();
    return limits[0] + Math.max(0, Math.min(1, part)) * (limits[1] - limits[0]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    pressed = true;
    canvas.setPointerCapture(event.pointerId);
    go(at(event), false);
  });
  canvas.addEventListener("pointermove", (event) => pressed && go(at(event), false));
  canvas.addEventListener("pointerup", (event) => {
    if (pressed) go(at(event), true);
    pressed = false;
  });
  canvas.addEventListener("pointercancel", () => { pressed = false; });
}
