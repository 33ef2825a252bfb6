// One band of the track over distance: limits, places that call for something, 95 % band, level.

import { BLUE, SKY, area, axisBelow, axisLeft, boxOf, fitting, label, line, pieces, prepared, roundRange, scale, ticks, within } from "./plot.js";
import { FINEST } from "./tiles.js";
import { WIDE, actionOf, km, kmDigits } from "./words.js";

const BESIDE = "#F0B27A"; // behind the blue line, and wider: what differs is seen at both sides

export const MARGINS = { left: 58, right: 12, top: 8, bottom: 20 };

/** The box and the scale along the line of a strip in a canvas. */
export function along(width, height, view) {
  const box = boxOf(width, height, MARGINS);
  return { box, x: scale(view, box.left, box.right) };
}

/** Kilometres below a strip. */
export function kilometres(pen, box, x, view, options = {}) {
  const { step, at } = ticks(view, fitting(box));
  axisBelow(pen, box, x, at, (place) => km(place, kmDigits(step)), { least: box.left - 20, most: box.right + MARGINS.right, ...options });
}

/** First and last bin of a strip that a view shows. */
function shown(strip, view) {
  const first = Math.floor((view[0] - strip.from_m) / strip.bin_m) - 1;
  const last = Math.ceil((view[1] - strip.from_m) / strip.bin_m) + 1;
  return [Math.max(0, first), Math.min(strip.low_mm.length - 1, last)];
}

/** The greatest size of a level and its 95 % band in a view [mm]. */
export function greatest(strip, view) {
  const [first, last] = shown(strip, view);
  let most = 0;
  for (let i = first; i <= last; i++) {
    if (strip.low_mm[i] === null) continue;
    const wide = WIDE * (strip.deviation_mm[i] || 0);
    most = Math.max(most, Math.abs(strip.low_mm[i] - wide), Math.abs(strip.high_mm[i] + wide));
  }
  return most;
}

/** The range that shows strips and the lowest limit. */
export function rangeOf(strips, view, limits = []) {
  const size = Math.max(...strips.map((one) => (one ? greatest(one, view) : 0)), limits.length ? 1.12 * limits[0].height_mm : 0, 0.05);
  return roundRange(1.04 * size);
}

/** The level at a place of a strip: {low, high, deviation} in mm, or null. */
export function valueAt(strip, place) {
  if (!strip) return null;
  const i = Math.floor((place - strip.from_m) / strip.bin_m);
  if (i < 0 || i >= strip.low_mm.length || strip.low_mm[i] === null) return null;
  return { low: strip.low_mm[i], high: strip.high_mm[i], deviation: strip.deviation_mm[i] };
}

/** Draws one trace: its 95 % band, then what lies between the least and the most of each bin. */
export function trace(pen, strip, view, x, y, colours) {
  const [first, last] = shown(strip, view);
  const at = (i) => x(strip.from_m + i * strip.bin_m + (strip.bin_m - FINEST) / 2); // the middle of a bin's points
  const wide = (i) => WIDE * (strip.deviation_mm[i] || 0);
  const runs = pieces(strip.low_mm, first, last);
  if (colours.band) {
    for (const [a, b] of runs) {
      area(pen, a, b, at, (i) => y(strip.low_mm[i] - wide(i)), (i) => y(strip.high_mm[i] + wide(i)), colours.band);
    }
  }
  for (const [a, b] of runs) {
    area(pen, a, b, at, (i) => y(strip.low_mm[i]), (i) => y(strip.high_mm[i]), colours.line);
    pen.strokeStyle = colours.line;
    pen.lineWidth = colours.width || 1;
    pen.beginPath();
    let last = strip.low_mm[a];
    for (let i = a; i <= b; i++) {
      const low = strip.low_mm[i], high = strip.high_mm[i], up = Math.abs(low - last) <= Math.abs(high - last);
      pen.lineTo(at(i), y(up ? low : high));
      if (high !== low) pen.lineTo(at(i), y(up ? high : low));
      last = up ? high : low;
    }
    if (a === b) pen.lineTo(at(a) + 1, y(strip.low_mm[a]));
    pen.stroke();
  }
  pen.lineWidth = 1;
}

/** Stretches that are not judged in the band, in a lighter grey. */
function notJudged(pen, box, strip, x) {
  pen.fillStyle = "rgba(110,118,126,0.11)";
  for (const one of strip.not_judged) {
    const start = Math.max(box.left, x(one.start_m)), end = Math.min(box.right, x(one.end_m));
    if (end > start) pen.fillRect(start, box.top, end - start, box.height);
  }
}

/** Why a place is not judged; empty where it is. */
export const reasonsAt = (strip, place) => strip?.not_judged.find((one) => one.start_m <= place && place <= one.end_m)?.reasons || "";

/** Where nothing is known, greyed: a flat line would be a lie. */
export function unknown(pen, box, strip, view, x) {
  const [first, last] = shown(strip, view);
  pen.fillStyle = "rgba(110,118,126,0.20)";
  for (const [a, b] of pieces(strip.low_mm.map((value) => (value === null ? 0 : null)), first, last)) {
    const start = x(strip.from_m + a * strip.bin_m), end = x(strip.from_m + (b + 1) * strip.bin_m);
    if (end > box.left && start < box.right) pen.fillRect(start, box.top, Math.max(1, end - start), box.height);
  }
}

/** Limits as dashed lines on both sides, named once at the right. */
export function limitLines(pen, box, y, range, limits) {
  for (const { action, height_mm: height } of limits) {
    if (height > range[1]) continue;
    pen.strokeStyle = actionOf(action).colour;
    pen.setLineDash([7, 4]);
    for (const sign of [1, -1]) line(pen, box.left, y(sign * height), box.right, y(sign * height));
    pen.setLineDash([]);
  }
}

/** Names of limits at the right: outside of their lines if there is room, else inside, and none over another. */
function limitNames(pen, box, y, range, limits) {
  const taken = [], lines = limits.flatMap((one) => [y(one.height_mm), y(-one.height_mm)]);
  for (const { action, height_mm: height } of [...limits].reverse()) {
    if (height > range[1]) continue;
    const place = [y(height) - 8, y(-height) + 8, y(height) + 8, y(-height) - 8].find((one) =>
      one > box.top + 19 && one < box.bottom - 7 && taken.every((other) => Math.abs(one - other) > 14) && lines.every((other) => Math.abs(one - other) > 7));
    if (place === undefined) continue;
    label(pen, `${action} ${height} mm`, box.right - 4, place, actionOf(action).ink, "right");
    taken.push(place);
  }
}

/** Places that call for something, as far as they are wide enough to be tinted. */
function tints(pen, box, x, defects) {
  for (const one of defects) {
    const { colour, grade } = actionOf(one.calls_for), start = x(one.start_m), end = x(one.end_m);
    if (end < box.left || start > box.right || end - start < 1.5) continue;
    pen.globalAlpha = grade ? 0.22 : 0.14;
    pen.fillStyle = colour;
    pen.fillRect(start, box.top, end - start, box.height);
    pen.globalAlpha = 1;
  }
}

/** Their marks, whose shape tells the action; the gravest, which come first, above the others. */
function marks(pen, box, x, defects) {
  for (const one of [...defects].reverse()) {
    const { colour, grade } = actionOf(one.calls_for), place = x(one.peak_m);
    if (place >= box.left && place <= box.right) mark(pen, place, box.top + 6, grade, colour);
  }
}

/** Circle, triangle, diamond, square: told apart without colour. */
export function mark(pen, x, y, grade, colour, size = 4.5) {
  pen.fillStyle = colour;
  pen.beginPath();
  if (grade === 0) pen.arc(x, y, 0.6 * size, 0, 2 * Math.PI);
  else if (grade === 1) { pen.moveTo(x - size, y + size * 0.8); pen.lineTo(x, y - size); pen.lineTo(x + size, y + size * 0.8); }
  else if (grade === 2) { pen.moveTo(x - size, y); pen.lineTo(x, y - size); pen.lineTo(x + size, y); pen.lineTo(x, y + size); }
  else pen.rect(x - size * 0.9, y - size * 0.9, size * 1.8, size * 1.8);
  pen.fill();
}

/** A whole strip. `pinned` is a place to mark; `bare` leaves the kilometres out. */
export function drawStrip(canvas, { strip, beside, view, limits = [], defects = [], pinned, bare }) {
  const { pen, width, height } = prepared(canvas), { box, x } = along(width, height, view);
  const range = rangeOf([strip, beside], view, limits), y = scale(range, box.bottom, box.top);
  kilometres(pen, box, x, view, { unnamed: bare });
  axisLeft(pen, box, y, range);
  within(pen, box, () => {
    if (strip) {
      notJudged(pen, box, strip, x);
      unknown(pen, box, strip, view, x);
    }
    tints(pen, box, x, defects);
    // Behind single lines the other is wider; behind what lies between least and greatest it would seem greater.
    if (beside) trace(pen, beside, view, x, y, { line: BESIDE, width: beside.bin_m > 2 ? 1 : 4 });
    if (strip) trace(pen, strip, view, x, y, { line: BLUE, band: SKY });
    limitLines(pen, box, y, range, limits);
    pin(pen, box, x, pinned);
  });
  limitNames(pen, box, y, range, limits);
  marks(pen, box, x, defects);
  return range;
}

export function pin(pen, box, x, place) {
  if (place === undefined) return;
  pen.strokeStyle = "#111";
  pen.setLineDash([2, 3]);
  line(pen, x(place), box.top, x(place), box.bottom);
  pen.setLineDash([]);
}

/** Standard deviations per section as bars with their 95 % interval. */
export function drawSections(canvas, { sections, view }) {
  const { pen, width, height } = prepared(canvas), { box, x } = along(width, height, view);
  const inside = sections.filter((one) => one.end_m > view[0] && one.start_m < view[1]);
  const most = Math.max(0.1, ...inside.map((one) => one.high_mm)) * 1.08, y = scale([0, most], box.bottom, box.top);
  kilometres(pen, box, x, view);
  axisLeft(pen, box, y, [0, most], { count: 3 });
  within(pen, box, () => {
    for (const one of inside) {
      const start = x(one.start_m), wide = Math.max(1, x(one.end_m) - start - (x(one.end_m) - start > 4 ? 1 : 0));
      pen.fillStyle = "#7FB2D3";
      pen.fillRect(start, y(one.standard_deviation_mm), wide, y(0) - y(one.standard_deviation_mm));
      if (wide < 5) continue;
      pen.fillStyle = "#333";
      pen.fillRect(start + wide / 2 - 0.5, y(one.high_mm), 1, Math.max(1, y(one.low_mm) - y(one.high_mm)));
      const left = Math.max(start, box.left), right = Math.min(start + wide, box.right);
      if (right - left < 16 || !one.quality_class) continue;
      pen.textAlign = "center";
      pen.fillText(one.quality_class, (left + right) / 2, y(0) - 4);
    }
  });
}
