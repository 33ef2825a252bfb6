// A place over time: passes with their intervals, trend, forecast and limits; and its surroundings pass by pass.

import { BLUE, INK, area, axisBelow, axisLeft, boxOf, label, line, prepared, roundRange, scale, ticks, within } from "./plot.js";
import { MARGINS, kilometres, limitLines, pin } from "./strips.js";
import { WIDE, actionOf, dayNumber, dayOf } from "./words.js";

/** First days of months, quarters or years: about so many within a range of days. */
export function dateTicks(range, count) {
  const months = Math.max(1, (range[1] - range[0]) / 30.4 / count);
  const step = [1, 2, 3, 6, 12, 24, 60, 120].find((one) => one >= months) || 120, found = [];
  const first = new Date(range[0] * 86400000);
  for (let month = first.getUTCFullYear() * 12; ; month += step) {
    const at = Date.UTC(Math.floor(month / 12), month % 12, 1) / 86400000;
    if (at > range[1]) break;
    if (at >= range[0]) found.push(at);
  }
  if (found.length > 1) return { at: found, name: (at) => (step >= 12 ? dayOf(at).slice(0, 4) : dayOf(at).slice(0, 7)) };
  const { at } = ticks([Math.ceil(range[0]), Math.floor(range[1])], count);
  return { at: at.filter((one) => Number.isInteger(one)), name: dayOf };
}

function timeRange(found) {
  const days = found.passes.map((one) => dayNumber(one.day)), first = Math.min(...days), last = Math.max(...days);
  const ahead = found.forecast.length ? dayNumber(found.forecast[found.forecast.length - 1].day) : last;
  const margin = Math.max(2, 0.03 * (ahead - first));
  return { days, last, range: [first - margin, ahead + margin] };
}

function levelRange(found) {
  const sides = found.level_mm.flatMap((level, i) => [level - WIDE * found.deviation_mm[i], level + WIDE * found.deviation_mm[i]]);
  const lines = found.forecast.flatMap((one) => [one.level_mm]);
  const side = Math.sign(found.level_mm.reduce((sum, one) => sum + one, 0)) || -1;
  const limit = found.limits.find((one) => one.height_mm > Math.max(...found.level_mm.map(Math.abs))) || found.limits[0];
  const all = [0, ...sides, ...lines, ...(limit ? [side * limit.height_mm * 1.06] : [])];
  const least = Math.min(...all), most = Math.max(...all), spare = 0.06 * (most - least || 1);
  return [least - (least < 0 ? spare : 0), most + (most > 0 ? spare : 0)];
}

export function drawTime(canvas, found) {
  const { pen, width, height } = prepared(canvas), box = boxOf(width, height, MARGINS);
  const { days, last, range } = timeRange(found), levels = levelRange(found);
  const x = scale(range, box.left, box.right), y = scale(levels, box.bottom, box.top);
  const { at, name } = dateTicks(range, Math.max(2, box.width / 100));
  axisBelow(pen, box, x, at, name, { least: box.left, most: width });
  axisLeft(pen, box, y, levels);
  within(pen, box, () => {
    limitLines(pen, box, y, [levels[0], Math.max(-levels[0], levels[1])], found.limits);
    if (found.forecast.length) trend(pen, box, found.forecast, x, y, last);
    days.forEach((day, i) => point(pen, x(day), y, found.level_mm[i], found.deviation_mm[i]));
  });
  limitNames(pen, box, y, found);
  if (found.forecast.length && x(last) < box.right - 70) label(pen, "forecast →", x(last) + 6, levels[1] > -levels[0] ? box.bottom - 9 : box.top + 9, "#555");
}

/** Names of limits, at the end of the time where the level is farther from them. */
function limitNames(pen, box, y, found) {
  const ends = found.forecast.length ? [found.forecast[0], found.forecast[found.forecast.length - 1]].map((one) => one.level_mm) : [found.level_mm[0], 0];
  for (const { action, height_mm: limit } of found.limits) {
    for (const sign of [1, -1]) {
      const place = y(sign * limit), atRight = Math.abs(ends[1] - sign * limit) > Math.abs(ends[0] - sign * limit);
      if (place < box.top + 12 || place > box.bottom) continue;
      label(pen, `${action} ${limit} mm`, atRight ? box.right - 4 : box.left + 6, place - 8, actionOf(action).ink, atRight ? "right" : "left");
    }
  }
}

function trend(pen, box, forecast, x, y, last) {
  const at = forecast.map((one) => x(dayNumber(one.day)));
  area(pen, 0, forecast.length - 1, (i) => at[i], (i) => y(forecast[i].level_mm - WIDE * forecast[i].deviation_mm), (i) => y(forecast[i].level_mm + WIDE * forecast[i].deviation_mm), "rgba(86,180,233,0.30)");
  const split = forecast.findIndex((one) => dayNumber(one.day) >= last);
  pen.strokeStyle = BLUE;
  pen.lineWidth = 1.5;
  [[0, split, []], [split, forecast.length - 1, [6, 5]]].forEach(([from, to, dash]) => {
    pen.setLineDash(dash);
    pen.beginPath();
    for (let i = from; i <= to; i++) pen.lineTo(at[i], y(forecast[i].level_mm));
    pen.stroke();
  });
  pen.setLineDash([]);
  pen.lineWidth = 1;
  pen.strokeStyle = "#9aa4ad";
  line(pen, x(last), box.top, x(last), box.bottom);
}

function point(pen, place, y, level, deviation) {
  pen.strokeStyle = INK;
  pen.lineWidth = 1.2;
  const wide = WIDE * deviation;
  line(pen, place, y(level - wide), place, y(level + wide));
  for (const end of [level - wide, level + wide]) line(pen, place - 3, y(end), place + 3, y(end));
  pen.fillStyle = INK;
  pen.beginPath();
  pen.arc(place, y(level), 3.2, 0, 2 * Math.PI);
  pen.fill();
  pen.lineWidth = 1;
}

/** Blue, the darker the later. */
export const shade = (part) => `hsl(205, ${45 + 40 * part}%, ${78 - 52 * part}%)`;

export function drawAround(canvas, found) {
  const { pen, width, height } = prepared(canvas), box = boxOf(width, height, MARGINS), { distance_m: distance, levels_mm: levels } = found.around;
  if (distance.length < 2) return;
  const view = [distance[0], distance[distance.length - 1]], x = scale(view, box.left, box.right);
  const size = Math.max(0.1, ...levels.flat().filter((one) => one !== null).map(Math.abs)), range = roundRange(1.05 * size), y = scale(range, box.bottom, box.top);
  kilometres(pen, box, x, view);
  axisLeft(pen, box, y, range);
  within(pen, box, () => {
    limitLines(pen, box, y, range, found.limits);
    levels.forEach((level, k) => {
      pen.strokeStyle = shade(levels.length > 1 ? k / (levels.length - 1) : 1);
      pen.lineWidth = k === levels.length - 1 ? 2 : 1.2;
      pen.beginPath();
      level.forEach((value, i) => (value === null ? 0 : pen.lineTo(x(distance[i]), y(value))));
      pen.stroke();
    });
    pin(pen, box, x, found.at_m);
  });
}
