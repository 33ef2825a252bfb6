// Isolated defects: on the line's schematic, and as a table that leads to each of them.

import { request } from "./api.js";
import { caveats, choice, el, fill, table } from "./dom.js";
import { ACTIONS, actionOf, actionText } from "./shared/actions.js";
import { counted, km, kmDigits, number, percent, plusMinus } from "./shared/format.js";
import { addPicking, drawSchematic } from "./shared/schematic.js";

const ROWS = 50, SCHEMATIC_BINS = 400;
const MARGIN_M = 100; // to each side of a location that a link shows
const MINIMUM_ACTIONS = [["", "all"], ["alert", "alert or more severe"], ["intervention", "intervention or more severe"], ["immediate action", "immediate action"]];
const HEADS = [{ name: "Location" }, { name: "Required action" }, { name: "Band" }, { name: "Height, mm", number: true }, { name: "Limit, mm", number: true },
  { name: "Probability", number: true }, { name: "Length, m", number: true, minor: true }, { name: "See" }];

export function mount(root, app) {
  const canvas = el("canvas", { class: "schematic", role: "img", "aria-label": "Defects along the line" });
  const summary = el("p", { class: "first" }), tools = el("div", { class: "tools" }), rows = el("div", {}), pages = el("p", { class: "pages" }), notes = el("div", {});
  let marks = [], bar = null;
  fill(root, el("h1", {}, "Isolated defects"), summary, canvas, tools, rows, pages, notes);
  addPicking(canvas, () => bar, () => app.whole(), (distance, isLast) => {
    if (!isLast) return;
    const [start, end] = app.whole(), length = Math.max(500, (end - start) / 40);
    app.go({ view: "line", from: Math.max(start, distance - length / 2), to: Math.min(end, distance + length / 2) });
  });

  function draw() {
    bar = drawSchematic(canvas, { whole: app.whole(), marks, chainage: (distance, step) => km(distance, kmDigits(step)) });
  }

  function fillFilters(state) {
    const filter = (key) => (value) => app.go({ [key]: value || undefined, page: undefined });
    const hasStretch = state.from !== undefined && state.to !== undefined;
    fill(tools,
      choice("Show", MINIMUM_ACTIONS, state.minimum_action || "", filter("minimum_action")),
      choice("in", [["", "all bands"], ...app.bands.map((band) => [band.name, band.name])], state.band_filter || "", filter("band_filter")),
      choice("Order", [["", "most severe first"], ["distance", "along the line"]], state.order || "", filter("order")),
      hasStretch && el("span", {}, `${km(state.from)} to ${km(state.to)} `, el("button", { type: "button", onclick: () => app.go({ from: undefined, to: undefined, page: undefined }) }, "whole line")));
  }

  function fillSummary({ counts }) {
    const parts = ACTIONS.filter((action) => counts[actionText(action.key)]).map((action) =>
      el("span", { class: `count grade-${action.grade}` }, `${counted(counts[actionText(action.key)], "location")}: ${actionText(action.key)}`));
    fill(summary, parts.length ? parts : "No limit is exceeded with a probability of 5 % or more.");
  }

  function row(defect) {
    const action = defect.required_action || "alert", { peak_m: at, band } = defect, [start, end] = app.whole(), { grade } = actionOf(defect.required_action);
    const stretch = { from: Math.max(start, at - MARGIN_M), to: Math.min(end, at + MARGIN_M), at, band, entry: app.state.entry };
    return {
      mark: `grade-${grade}`,
      cells: [
        el("a", { href: app.href({ ...stretch, view: "line" }), "data-top": true }, km(at)),
        el("span", { class: "action" }, el("i", { class: `sign grade-${grade}`, "aria-hidden": "true" }), actionText(defect.required_action)), band,
        { number: number(defect.height_mm, 1) + plusMinus(defect.standard_deviation_mm) }, { number: number(defect.limits_mm[action], 1) },
        { number: percent(defect.probabilities[action]) }, { number: number(defect.end_m - defect.start_m, 1) },
        el("a", { href: app.href({ view: "location", at, band }), "data-top": true, "aria-label": `development at ${km(at)}` }, "development"),
      ],
    };
  }

  function fillPages(total) {
    const page = app.state.page || 1, last = Math.max(1, Math.ceil(total / ROWS));
    const link = (to, text) => (to >= 1 && to <= last ? el("a", { href: app.href({ page: to > 1 ? to : undefined }), "data-top": true }, text) : el("span", { class: "off" }, text));
    fill(pages, total > 0 && [link(page - 1, "‹ previous"), ` ${(page - 1) * ROWS + 1} to ${Math.min(page * ROWS, total)} of ${total} `, link(page + 1, "next ›")]);
  }

  return {
    async update(state) {
      app.setBusy(true);
      fillFilters(state);
      const page = Math.max(1, Math.round(state.page || 1));
      const [schematic, answer] = await Promise.all([
        request("schematic", { ...app.selection(), bins: SCHEMATIC_BINS }),
        request("defects", { ...app.selection(), band: state.band_filter, from: state.from, to: state.to, minimum_action: state.minimum_action, order: state.order === "distance" ? "distance" : "severity", offset: (page - 1) * ROWS, count: ROWS }),
      ]);
      marks = schematic.bins;
      fillSummary(answer);
      fill(rows, answer.defects.length > 0 && table(HEADS, answer.defects.map(row), { label: "Isolated defects; the probability is that the true level exceeds the limit", id: "defects" }));
      fillPages(answer.total);
      fill(notes, answer.requirements.length > 0 && el("dl", { class: "requirements" }, answer.requirements.map((one) => [el("dt", {}, one.action), el("dd", {}, one.requirement)])),
        caveats(answer.notes));
      draw();
      app.setBusy(false);
    },
    draw,
  };
}
