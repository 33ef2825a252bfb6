// Charts, drawn by uPlot (global `uPlot`). What a chart needs beyond lines and areas is drawn in uPlot's hooks.

import { actionOf } from "./actions.js";
import { FONT, colour, drawLine, drawMark } from "./canvas.js";
import { binCentres, levelRange, unknownStretches, visibleBins } from "./envelope.js";
import { HALF_WIDTH_95, number } from "./format.js";
import { addGestures } from "./gestures.js";
import { ROUND_STEPS, decimalsFor } from "./ticks.js";

/** Widths around the plotting area in CSS pixels; half of a tick label fits at the right. */
export const LEFT = 58, RIGHT = 36;
const TOP = 8, BOTTOM = 22;

const sizeOf = (container) => ({ width: Math.max(120, container.clientWidth), height: Math.max(60, container.clientHeight) });
const resize = (plot, container) => plot.setSize(sizeOf(container));

/** A uPlot that fills a container and follows its size. `series` and `bands` are those of uPlot. */
export function plotIn(container, { data, scales, axes, series, bands = [], hooks = {}, group }) {
  const none = () => null;
  let observer = null;
  const plot = new uPlot({
    ...sizeOf(container), scales, axes, series: [{}, ...series.map((one) => ({ points: { show: false }, pxAlign: 0, ...one }))], bands,
    hooks: { ...hooks, destroy: [() => observer.disconnect()] }, padding: [TOP, RIGHT, 0, 0], legend: { show: false },
    cursor: {
      y: false, points: { show: false }, drag: { x: false, y: false, setScale: false },
      bind: { mousedown: none, mouseup: none, click: none, dblclick: none },
      ...(group && { sync: { key: group, setSeries: false, scales: ["x", null] } }),
    },
    tzDate: (seconds) => uPlot.tzDate(new Date(1000 * seconds), "UTC"),
  }, data, container);
  observer = new ResizeObserver(() => container.clientWidth && resize(plot, container));
  observer.observe(container);
  return plot;
}

const axis = (options) => ({ stroke: colour("ink"), font: FONT, grid: { stroke: colour("grid"), width: 1 }, ticks: { show: false }, ...options });

/** A horizontal axis; `name(value, step)` labels a tick. */
export const horizontalAxis = (name, options = {}) => axis({ size: BOTTOM, gap: 5, space: 92, incrs: ROUND_STEPS, values: (_, ticks, _axis, _space, step) => ticks.map((tick) => name(tick, step)), ...options });

/** A horizontal axis with grid lines only. */
export const bareAxis = () => horizontalAxis(() => "", { size: 6 });

/** A vertical axis of numbers. */
export const verticalAxis = (options = {}) => axis({ size: LEFT, gap: 6, space: 30, incrs: ROUND_STEPS, values: (_, ticks, _axis, _space, step) => ticks.map((tick) => number(tick, decimalsFor(step))), ...options });

/** Draws inside the plotting area of a uPlot, in CSS pixels: `paint(pen, {x, y, left, right, top, bottom, height})`. */
export function paintInside(plot, paint) {
  const { ctx: pen } = plot, ratio = uPlot.pxRatio, { left, top, width, height } = plot.bbox;
  pen.save();
  pen.beginPath();
  pen.rect(left, top, width, height);
  pen.clip();
  pen.scale(ratio, ratio);
  pen.font = FONT;
  pen.textBaseline = "alphabetic";
  pen.lineWidth = 1;
  paint(pen, {
    x: (value) => plot.valToPos(value, "x", true) / ratio, y: (value) => plot.valToPos(value, "y", true) / ratio,
    left: left / ratio, right: (left + width) / ratio, top: top / ratio, bottom: (top + height) / ratio, height: height / ratio,
  });
  pen.restore();
}

/** A label that stays readable over lines; y is its middle. */
export function drawLabel(pen, text, x, y, ink, align = "left") {
  const width = pen.measureText(text).width;
  pen.textAlign = align;
  pen.fillStyle = colour("paper", 0.85);
  pen.fillRect(align === "right" ? x - width - 2 : x - 2, y - 7, width + 4, 14);
  pen.fillStyle = ink;
  pen.fillText(text, x, y + 4);
}

/** Limits as dashed lines on both sides of zero. */
export function drawLimits(pen, box, limits) {
  pen.setLineDash([7, 4]);
  for (const { action, height_mm: height } of limits) {
    pen.strokeStyle = colour(actionOf(action).property);
    for (const sign of [1, -1]) drawLine(pen, box.left, box.y(sign * height), box.right, box.y(sign * height));
  }
  pen.setLineDash([]);
}

/** Names of limits at the right: outside of their lines where there is room, else inside, and none over another. */
function drawLimitNames(pen, box, limits) {
  const used = [], lines = limits.flatMap(({ height_mm: height }) => [box.y(height), box.y(-height)]);
  for (const { action, height_mm: height } of [...limits].reverse()) {
    const at = [box.y(height) - 8, box.y(-height) + 8, box.y(height) + 8, box.y(-height) - 8].find((middle) =>
      middle > box.top + 19 && middle < box.bottom - 7 && used.every((other) => Math.abs(middle - other) > 14) && lines.every((line) => Math.abs(middle - line) > 7));
    if (at === undefined) continue;
    drawLabel(pen, `${action} ${height} mm`, box.right - 4, at, colour(`${actionOf(action).property}-text`), "right");
    used.push(at);
  }
}

/** A dotted vertical line at a marked distance. */
export function drawPin(pen, box, distance) {
  if (distance === undefined) return;
  pen.strokeStyle = colour("ink");
  pen.setLineDash([2, 3]);
  drawLine(pen, box.x(distance), box.top, box.x(distance), box.bottom);
  pen.setLineDash([]);
}

function shade(pen, box, start, end, fill, narrowest = 0) {
  const left = Math.max(box.left, box.x(start)), right = Math.min(box.right, Math.max(box.x(end), box.x(start) + narrowest));
  if (right <= left) return;
  pen.fillStyle = fill;
  pen.fillRect(left, box.top, right - left, box.height);
}

/** Stretches that are not assessed, without data, or with a defect. */
function shadeStretches(pen, box, { envelope, view, defects = [] }) {
  if (envelope) {
    for (const one of envelope.not_assessed || []) shade(pen, box, one.start_m, one.end_m, colour("muted", 0.11));
    for (const [start, end] of unknownStretches(envelope, visibleBins(envelope, view))) shade(pen, box, start, end, colour("muted", 0.2), 1);
  }
  for (const one of defects) {
    const { property, grade } = actionOf(one.required_action);
    if (box.x(one.end_m) - box.x(one.start_m) >= 1.5) shade(pen, box, one.start_m, one.end_m, colour(property, grade ? 0.22 : 0.14));
  }
}

/** Marks of defects at the top; the most severe, which come first, above the others. */
function markDefects(pen, box, defects) {
  for (const one of [...defects].reverse()) {
    const { property, grade } = actionOf(one.required_action);
    drawMark(pen, box.x(one.peak_m), box.top + 6, grade, colour(property));
  }
}

/** Whether all parts of an update are those that a chart shows. */
const isShown = (shown, next) => Object.keys(next).every((key) => next[key] === shown[key]);

/** Columns of a table of uPlot from an envelope: distance, interval (high, low), level (high, low). */
function envelopeTable(envelope) {
  if (!envelope) return [[], [], [], [], []];
  const { low_mm: low, high_mm: high, standard_deviation_mm: deviation } = envelope;
  const half = (i) => HALF_WIDTH_95 * (deviation[i] || 0);
  return [
    binCentres(envelope), high.map((value, i) => (value === null ? null : value + half(i))),
    low.map((value, i) => (value === null ? null : value - half(i))), high, low,
  ];
}

/**
 * The level in a band over distance, in mm: its 95 % interval, limits, defects, and optionally the level of another
 * pass (`compared`), drawn wider behind it so that differences show on both sides.
 * `port` is that of `addGestures`; charts of a `group` share the cursor. `update` takes {envelope, compared, view,
 * limits, defects, pinned}.
 */
export function levelChart(container, { port, chainage, group, bare = false, hasCompared = false }) {
  const shown = { envelope: null, compared: null, view: [0, 1], limits: [], defects: [], pinned: undefined };
  const visibleLimits = () => shown.limits.filter((limit) => limit.height_mm <= range()[1]);
  const range = () => levelRange([shown.envelope, shown.compared], shown.view, shown.limits);
  const level = colour("level"), compared = colour("compared");
  const first = hasCompared ? 3 : 1;
  const plot = plotIn(container, {
    data: table(), group,
    scales: { x: { time: false }, y: { range } },
    axes: [bare ? bareAxis() : horizontalAxis(chainage), verticalAxis()],
    series: [...(hasCompared ? [{ stroke: compared, width: 4 }, { stroke: compared, width: 4 }] : []), {}, {}, { stroke: level, width: 1 }, { stroke: level, width: 1 }],
    bands: [
      ...(hasCompared ? [{ series: [1, 2], fill: compared }] : []),
      { series: [first, first + 1], fill: colour("interval", 0.42) }, { series: [first + 2, first + 3], fill: level },
    ],
    hooks: {
      drawAxes: [(self) => paintInside(self, (pen, box) => shadeStretches(pen, box, shown))],
      draw: [(self) => paintInside(self, (pen, box) => {
        drawLimits(pen, box, visibleLimits());
        drawPin(pen, box, shown.pinned);
        drawLimitNames(pen, box, visibleLimits());
        markDefects(pen, box, shown.defects);
      })],
    },
  });
  addGestures(plot.over, port);

  function table() {
    const own = envelopeTable(shown.envelope);
    if (!hasCompared) return own;
    const [distance, , , high, low] = envelopeTable(shown.compared);
    return uPlot.join([[distance, high, low], own]);
  }

  return {
    resize: () => resize(plot, container),
    update(next) {
      if (isShown(shown, next)) return;
      const isNew = next.envelope !== shown.envelope || next.compared !== shown.compared;
      Object.assign(shown, next);
      // Behind single lines the other level is wider; behind the range of a bin it would seem larger.
      if (hasCompared) for (const i of [1, 2]) plot.series[i].width = shown.compared?.bin_m > 2 ? 1 : 4;
      plot.batch(() => {
        if (isNew) plot.setData(table(), false);
        plot.setScale("x", { min: shown.view[0], max: shown.view[1] });
      });
    },
  };
}

/** Standard deviations per section as bars with their 95 % interval; `update` takes {sections, view}. */
export function sectionChart(container, { port, chainage, group }) {
  const shown = { sections: [], view: [0, 1] };
  const inside = () => shown.sections.filter((one) => one.end_m > shown.view[0] && one.start_m < shown.view[1]);
  const plot = plotIn(container, {
    data: [[0], [null]], group,
    scales: { x: { time: false }, y: { range: () => [0, 1.08 * Math.max(0.1, ...inside().map((one) => one.high_mm))] } },
    axes: [horizontalAxis(chainage), verticalAxis({ space: 26 })],
    series: [{}],
    hooks: { draw: [(self) => paintInside(self, (pen, box) => drawSections(pen, box, inside()))] },
  });
  addGestures(plot.over, port);
  return {
    resize: () => resize(plot, container),
    update(next) {
      if (isShown(shown, next)) return;
      Object.assign(shown, next);
      plot.setScale("x", { min: shown.view[0], max: shown.view[1] });
    },
  };
}

/** Bars with the class of their section, which also gives the colour where its number is known. */
function drawSections(pen, box, sections) {
  for (const one of sections) {
    const start = box.x(one.start_m), end = box.x(one.end_m), width = Math.max(1, end - start - (end - start > 4 ? 1 : 0));
    pen.fillStyle = one.class_number >= 0 ? colour(`class-${one.class_number}`) : colour("level", 0.5);
    pen.fillRect(start, box.y(one.standard_deviation_mm), width, box.y(0) - box.y(one.standard_deviation_mm));
    if (width < 5) continue;
    pen.fillStyle = colour("ink");
    pen.fillRect(start + width / 2 - 0.5, box.y(one.high_mm), 1, Math.max(1, box.y(one.low_mm) - box.y(one.high_mm)));
    const left = Math.max(start, box.left), right = Math.min(start + width, box.right);
    if (right - left < 16 || !one.quality_class) continue;
    pen.textAlign = "center";
    pen.fillText(one.quality_class, (left + right) / 2, box.y(0) - 4);
  }
}
