// One location over time (passes, trend, forecast, limits), and its surroundings pass by pass.

import { actionOf } from "./shared/actions.js";
import { colour, drawLine } from "./shared/canvas.js";
import { drawLabel, drawLimits, drawPin, horizontalAxis, paintInside, plotIn, verticalAxis } from "./shared/charts.js";
import { roundRange } from "./shared/envelope.js";
import { HALF_WIDTH_95, dateText, dayNumber, km, kmDigits } from "./shared/format.js";

const DAY_S = 86400, MONTH_DAYS = 28, YEAR_DAYS = 365;
const DATE_STEPS = [...[1, 2, 7].map((days) => days * DAY_S), ...[1, 2, 3, 4, 6].map((months) => months * 30 * DAY_S), ...[1, 2, 5, 10].map((years) => years * YEAR_DAYS * DAY_S)];
const seconds = (date) => DAY_S * dayNumber(date);

/** A date tick: year, month or day, whichever distinguishes ticks `step` seconds apart. */
export function dateTick(time, step) {
  const text = dateText(Math.round(time / DAY_S));
  return step >= YEAR_DAYS * DAY_S ? text.slice(0, 4) : step >= MONTH_DAYS * DAY_S ? text.slice(0, 7) : text;
}

/** First and last time shown, s. */
export function timeRange({ passes, forecast }) {
  const times = [...passes.map((one) => seconds(one.day)), ...forecast.slice(-1).map((one) => seconds(one.day))];
  const first = Math.min(...times), last = Math.max(...times), margin = Math.max(2 * DAY_S, 0.03 * (last - first));
  return [first - margin, last + margin];
}

/** Lowest and highest level shown, mm: the passes with their intervals, the trend, and the next limit on their side. */
export function levelRangeOf({ level_mm: levels, standard_deviation_mm: deviations, forecast, limits }) {
  const ends = levels.flatMap((level, i) => [level - HALF_WIDTH_95 * deviations[i], level + HALF_WIDTH_95 * deviations[i]]);
  const side = Math.sign(levels.reduce((sum, one) => sum + one, 0)) || -1;
  const limit = limits.find((one) => one.height_mm > Math.max(...levels.map(Math.abs))) || limits[0];
  const all = [0, ...ends, ...forecast.map((one) => one.level_mm), ...(limit ? [side * limit.height_mm * 1.06] : [])];
  const lowest = Math.min(...all), highest = Math.max(...all), margin = 0.06 * (highest - lowest || 1);
  return [lowest - (lowest < 0 ? margin : 0), highest + (highest > 0 ? margin : 0)];
}

/** The level of a location over time. */
export function developmentChart(container, development) {
  const { forecast } = development, last = seconds(development.passes[development.passes.length - 1].day);
  const times = forecast.map((one) => seconds(one.day)), levels = forecast.map((one) => one.level_mm);
  const edge = (sign) => forecast.map((one) => one.level_mm + sign * HALF_WIDTH_95 * one.standard_deviation_mm);
  const line = { stroke: colour("level"), width: 1.5 };
  return plotIn(container, {
    data: forecast.length ? [times, edge(1), edge(-1), levels.map((level, i) => (times[i] <= last ? level : null)), levels.map((level, i) => (times[i] >= last ? level : null))] : [[last], [null], [null], [null], [null]],
    scales: { x: { time: true, range: () => timeRange(development) }, y: { range: () => levelRangeOf(development) } },
    axes: [horizontalAxis(dateTick, { incrs: DATE_STEPS, space: 100 }), verticalAxis()],
    series: [{}, {}, line, { ...line, dash: [6, 5] }],
    bands: [{ series: [1, 2], fill: colour("interval", 0.3) }],
    hooks: { draw: [(plot) => paintInside(plot, (pen, box) => {
      drawLimits(pen, box, development.limits);
      if (forecast.length) {
        pen.strokeStyle = colour("axis");
        drawLine(pen, box.x(last), box.top, box.x(last), box.bottom);
      }
      development.passes.forEach((pass, i) => drawPass(pen, box, seconds(pass.day), development.level_mm[i], development.standard_deviation_mm[i]));
      drawLimitNames(pen, box, development);
      const isBelow = box.y(0) < (box.top + box.bottom) / 2;
      if (forecast.length && box.x(last) < box.right - 70) drawLabel(pen, "forecast →", box.x(last) + 6, isBelow ? box.top + 9 : box.bottom - 9, colour("muted"));
    })] },
  });
}

/** Names of limits, at the end of the time where the level is farther from them. */
function drawLimitNames(pen, box, { forecast, level_mm: levels, limits }) {
  const ends = forecast.length ? [forecast[0].level_mm, forecast[forecast.length - 1].level_mm] : [levels[0], 0];
  for (const { action, height_mm: height } of limits) {
    for (const sign of [1, -1]) {
      const at = box.y(sign * height), isRight = Math.abs(ends[1] - sign * height) > Math.abs(ends[0] - sign * height);
      if (at < box.top + 12 || at > box.bottom) continue;
      drawLabel(pen, `${action} ${height} mm`, isRight ? box.right - 4 : box.left + 6, at - 8, colour(`${actionOf(action).property}-text`), isRight ? "right" : "left");
    }
  }
}

/** A pass as a dot with its 95 % interval. */
function drawPass(pen, box, time, level, deviation) {
  const x = box.x(time), half = HALF_WIDTH_95 * deviation;
  pen.strokeStyle = pen.fillStyle = colour("ink");
  pen.lineWidth = 1.2;
  drawLine(pen, x, box.y(level - half), x, box.y(level + half));
  for (const end of [level - half, level + half]) drawLine(pen, x - 3, box.y(end), x + 3, box.y(end));
  pen.beginPath();
  pen.arc(x, box.y(level), 3.2, 0, 2 * Math.PI);
  pen.fill();
}

/** Blue, darker for later passes; `part` from 0 to 1. */
export const passColour = (part) => `hsl(205, ${45 + 40 * part}%, ${78 - 52 * part}%)`;

/** The level around a location, a line per pass; null without two points. */
export function surroundingsChart(container, { surroundings, limits, at_m: location }) {
  const { distance_m: distance, levels_mm: levels } = surroundings;
  if (distance.length < 2) return null;
  const size = Math.max(0.1, ...levels.flat().filter((one) => one !== null).map(Math.abs)), range = roundRange(1.05 * size);
  const last = levels.length - 1;
  return plotIn(container, {
    data: [distance, ...levels],
    scales: { x: { time: false }, y: { range: () => range } },
    axes: [horizontalAxis((at, step) => km(at, kmDigits(step))), verticalAxis()],
    series: levels.map((_, i) => ({ stroke: passColour(last ? i / last : 1), width: i === last ? 2 : 1.2 })),
    hooks: { draw: [(plot) => paintInside(plot, (pen, box) => {
      drawLimits(pen, box, limits);
      drawPin(pen, box, location);
    })] },
  });
}
