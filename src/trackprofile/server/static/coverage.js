// Passes over the line as rows: the standard deviation of each along the line.

import { colour, drawDistanceAxis, innerBox, preparedCanvas } from "./shared/canvas.js";
import { HALF_WIDTH_95, km, kmDigits, number } from "./shared/format.js";
import { linearScale, roundTicks } from "./shared/ticks.js";

const MARGINS = { left: 82, right: 12, top: 2, bottom: 22 };
const SHADES = 7;
const LABEL_HEIGHT = 13;

/** Number of the shade of a standard deviation relative to the lowest one, 0 to 6: the last from four times on. */
export function shadeNumber(deviation, lowest) {
  const part = Math.log2(Math.max(1, deviation / lowest)) / 2;
  return Math.min(SHADES - 1, Math.floor(part * SHADES));
}

export function drawCoverage(canvas, quality, whole, day) {
  const { pen, box } = preparedCanvas(canvas, MARGINS), x = linearScale(whole, box.left, box.right);
  const passes = [...quality.passes].reverse(), rowHeight = box.height / Math.max(1, passes.length);
  const { step, at } = roundTicks(whole, Math.max(2.5, box.width / 88));
  drawDistanceAxis(pen, box, x, at, (distance) => km(distance, kmDigits(step)), box.right + MARGINS.right);
  const every = Math.ceil(LABEL_HEIGHT / rowHeight);
  passes.forEach((pass, row) => {
    const top = box.top + row * rowHeight;
    pen.fillStyle = colour("ink");
    pen.textAlign = "right";
    if (row % every === 0) {
      pen.font = pen.font.replace(/^(bold )?/, pass.day === day ? "bold " : "");
      pen.fillText(pass.day, box.left - 6, top + rowHeight / 2 + 4);
    }
    pass.standard_deviation_along_mm.forEach((deviation, i) => {
      const start = quality.start_m + i * quality.bin_m, end = start + quality.bin_m;
      if (end <= pass.start_m || start >= pass.end_m) return;
      const left = x(Math.max(start, whole[0])), right = x(Math.min(end, whole[1]));
      pen.fillStyle = deviation === null ? colour("muted", 0.3) : colour(`certainty-${shadeNumber(deviation, quality.lowest_standard_deviation_mm)}`);
      pen.fillRect(left, top + 0.5, right - left + 0.4, Math.max(1, rowHeight - 1));
    });
  });
}

/** What the pointer is on, as text. */
export function coverageText(canvas, quality, whole, event) {
  const edge = canvas.getBoundingClientRect(), box = innerBox(edge.width, edge.height, MARGINS);
  const distance = whole[0] + ((event.clientX - edge.left - box.left) / box.width) * (whole[1] - whole[0]);
  const row = Math.floor(((event.clientY - edge.top - box.top) / box.height) * quality.passes.length);
  const pass = [...quality.passes].reverse()[row];
  if (!pass || distance < whole[0] || distance > whole[1]) return "";
  const deviation = pass.standard_deviation_along_mm[Math.floor((distance - quality.start_m) / quality.bin_m)];
  const isKnown = deviation !== null && deviation !== undefined && distance >= pass.start_m && distance <= pass.end_m;
  return `${pass.day}, ${km(distance, 1)}: ${isKnown ? `± ${number(HALF_WIDTH_95 * deviation, 3)} mm` : "not known"}`;
}
