// The whole line as a bar: a lane per action, a mark per location, and the stretch that is shown.

import { ACTIONS } from "./actions.js";
import { FONT, colour, drawDistanceAxis, drawLine, drawMark, preparedCanvas } from "./canvas.js";
import { linearScale, roundTicks } from "./ticks.js";

/** Draws the line; `marks` are {required_action, peak_m}, `chainage(distance, step)` names a tick. Returns the box. */
export function drawSchematic(canvas, { whole, view, marks, chainage }) {
  const probe = canvas.getContext("2d");
  probe.font = FONT;
  const names = Math.max(...ACTIONS.map((action) => probe.measureText(action.short).width));
  const { pen, box } = preparedCanvas(canvas, { left: names + 14, right: 12, top: 2, bottom: 22 });
  const x = linearScale(whole, box.left, box.right), lane = box.height / ACTIONS.length;
  const { step, at } = roundTicks(whole, Math.max(2.5, box.width / 88));
  drawDistanceAxis(pen, box, x, at, (distance) => chainage(distance, step), box.right + 12);
  ACTIONS.forEach((action, i) => {
    const middle = box.top + (i + 0.5) * lane;
    pen.strokeStyle = colour("grid");
    drawLine(pen, box.left, middle, box.right, middle);
    pen.fillStyle = colour("ink");
    pen.textAlign = "right";
    pen.fillText(action.short, box.left - 8, middle + 4);
    for (const mark of marks) {
      if (mark.required_action === action.key) drawMark(pen, x(mark.peak_m), middle, action.grade, colour(action.property), Math.min(4.5, lane / 2.6));
    }
  });
  if (view && view[1] - view[0] < 0.999 * (whole[1] - whole[0])) drawWindow(pen, box, x(view[0]), x(view[1]));
  return box;
}

function drawWindow(pen, box, start, end) {
  const width = Math.max(4, end - start);
  pen.strokeStyle = colour("level");
  pen.fillStyle = colour("level", 0.1);
  pen.lineWidth = 2;
  pen.fillRect(start, box.top, width, box.height);
  pen.strokeRect(start, box.top + 1, width, box.height - 2);
}

/** Reports the distance at which the bar is clicked or dragged: `pick(distance, isLast)`. */
export function addPicking(canvas, box, whole, pick) {
  let pressed = false;
  const distanceAt = (event) => {
    const edge = canvas.getBoundingClientRect(), inner = box(), [start, end] = whole();
    const part = (event.clientX - edge.left - inner.left) / inner.width;
    return start + Math.max(0, Math.min(1, part)) * (end - start);
  };
  canvas.addEventListener("pointerdown", (event) => {
    pressed = true;
    canvas.setPointerCapture(event.pointerId);
    pick(distanceAt(event), false);
  });
  canvas.addEventListener("pointermove", (event) => pressed && pick(distanceAt(event), false));
  canvas.addEventListener("pointerup", (event) => {
    if (pressed) pick(distanceAt(event), true);
    pressed = false;
  });
  canvas.addEventListener("pointercancel", () => { pressed = false; });
}

