// Passes over the line as rows: how sure each one is, place by place.

import { INK, axisBelow, boxOf, fitting, prepared, scale, ticks } from "./plot.js";
import { WIDE, km, kmDigits, number } from "./words.js";

const MARGINS = { left: 82, right: 12, top: 2, bottom: 22 };
// From sure to unsure, of rising lightness: readable without colour (after cividis).
const SHADES = ["#00336F", "#3F4F6B", "#6B6B70", "#8F8A78", "#B9AC70", "#E3D057", "#FFEA46"];

/** The shade of a standard deviation beside the least one: up to four times. */
export function shadeOf(deviation, least) {
  const part = Math.log2(Math.max(1, deviation / least)) / 2;
  return SHADES[Math.min(SHADES.length - 1, Math.floor(part * SHADES.length))];
}

export function drawCoverage(canvas, found, whole, day) {
  const { pen, width, height } = prepared(canvas), box = boxOf(width, height, MARGINS), x = scale(whole, box.left, box.right);
  const rows = [...found.passes].reverse(), tall = box.height / Math.max(1, rows.length);
  const { step, at } = ticks(whole, fitting(box));
  axisBelow(pen, box, x, at, (place) => km(place, kmDigits(step)), { least: box.left - 20, most: width });
  const every = Math.ceil(13 / tall);
  rows.forEach((one, k) => {
    const top = box.top + k * tall;
    pen.fillStyle = INK;
    pen.textAlign = "right";
    if (k % every === 0) {
      pen.font = pen.font.replace(/^(bold )?/, one.day === day ? "bold " : "");
      pen.fillText(one.day, box.left - 6, top + tall / 2 + 4);
    }
    one.deviation_along_mm.forEach((deviation, i) => {
      const start = found.start_m + i * found.bin_m, left = x(Math.max(start, whole[0])), right = x(Math.min(start + found.bin_m, whole[1]));
      if (start + found.bin_m <= one.start_m || start >= one.end_m) return;
      pen.fillStyle = deviation === null ? "rgba(110,118,126,0.30)" : shadeOf(deviation, found.least_mm);
      pen.fillRect(left, top + 0.5, right - left + 0.4, Math.max(1, tall - 1));
    });
  });
}

export function readCoverage(canvas, found, whole, event) {
  const edge = canvas.getBoundingClientRect(), box = boxOf(edge.width, edge.height, MARGINS);
  const place = whole[0] + ((event.clientX - edge.left - box.left) / box.width) * (whole[1] - whole[0]);
  const row = Math.floor(((event.clientY - edge.top - box.top) / box.height) * found.passes.length);
  const one = [...found.passes].reverse()[row];
  if (!one || place < whole[0] || place > whole[1]) return "";
  const deviation = one.deviation_along_mm[Math.floor((place - found.start_m) / found.bin_m)];
  const words = deviation === null || deviation === undefined || place < one.start_m || place > one.end_m ? "not known" : `± ${number(WIDE * deviation, 3)} mm`;
  return `${one.day}, ${km(place, 1)}: ${words}`;
}
