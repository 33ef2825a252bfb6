// Places that call for something: on the line's schematic, and as a table that leads to each of them.

import { ask } from "./api.js";
import { choice, el, fill, table, warnings } from "./dom.js";
import { drawSchematic, pickOn } from "./schematic.js";
import { ACTIONS, actionOf, callsFor, counted, half, km, number, percent } from "./words.js";

const PAGE = 50, AROUND = 100; // rows; m to either side of a place that a link shows
const LEAST = [["", "all"], ["alert", "alert and graver"], ["intervention", "intervention and graver"], ["immediate action", "immediate action"]];

export function mount(root, app) {
  const canvas = el("canvas", { class: "schematic", role: "img", "aria-label": "Places along the line that call for something" });
  const said = el("p", { class: "first" }), tools = el("div", { class: "tools" }), rows = el("div", {}), pages = el("p", { class: "pages" }), notes = el("div", {});
  let bins = [], bar = null;
  fill(root, el("h1", {}, "Exceedances"), said, canvas, tools, rows, pages, notes);
  pickOn(canvas, () => bar, () => app.whole(), (place, done) => {
    if (!done) return;
    const [start, end] = app.whole(), length = Math.max(500, (end - start) / 40);
    app.go({ view: "line", from: Math.max(start, place - length / 2), to: Math.min(end, place + length / 2) });
  });

  function draw() {
    bar = drawSchematic(canvas, { whole: app.whole(), bins });
  }

  function filters(state) {
    const onlyHere = state.from !== undefined && state.to !== undefined;
    fill(tools,
      choice("Show", LEAST, state.least || "", (least) => app.go({ least: least || undefined, page: undefined })),
      choice("in", [["", "all bands"], ...app.bands.map((one) => [one.name, one.name])], state.only || "", (only) => app.go({ only: only || undefined, page: undefined })),
      choice("Order", [["", "gravest first"], ["along", "along the line"]], state.order || "", (order) => app.go({ order: order || undefined, page: undefined })),
      onlyHere && el("span", {}, `${km(state.from)} to ${km(state.to)} `, el("button", { type: "button", onclick: () => app.go({ from: undefined, to: undefined, page: undefined }) }, "the whole line")));
  }

  function summary(found) {
    const parts = ACTIONS.filter((one) => found.counts[callsFor(one.key)]).map((one) =>
      el("span", { class: `count grade-${one.grade}` }, `${counted(found.counts[callsFor(one.key)], "place")} ${one.key ? `for ${one.key}` : "possible"}`));
    fill(said, parts.length ? parts : "No limit is exceeded with 5 % or more.");
  }

  function list(found) {
    const heads = [{ name: "Place" }, { name: "Calls for" }, { name: "Band" }, { name: "Height, mm", number: true }, { name: "Limit, mm", number: true }, { name: "Probability", number: true },
      { name: "Length, m", number: true, minor: true }, { name: "Follow" }];
    fill(rows, found.defects.length > 0 && table(heads, found.defects.map((one) => {
      const judged = one.calls_for || "alert", at = one.peak_m, [start, end] = app.whole();
      const near = { from: Math.max(start, at - AROUND), to: Math.min(end, at + AROUND), at, band: one.band, entry: app.state.entry };
      return {
        mark: `grade-${actionOf(one.calls_for).grade}`,
        cells: [
          el("a", { href: app.href({ ...near, view: "line" }), "data-top": true }, km(at)),
          el("span", { class: "action" }, el("i", { class: `sign grade-${actionOf(one.calls_for).grade}`, "aria-hidden": "true" }), callsFor(one.calls_for)), one.band,
          { number: number(one.height_mm, 1) + half(one.standard_deviation_mm) }, { number: number(one.limits_mm[judged], 1) },
          { number: percent(one.probabilities[judged]) }, { number: number(one.end_m - one.start_m, 1) },
          el("a", { href: app.href({ view: "place", at, band: one.band }), "data-top": true, "aria-label": `development at ${km(at)}` }, "development"),
        ],
      };
    }), { label: "Isolated defects; the probability is that the true level exceeds the limit", id: "defects" }));
    const page = app.state.page || 1, last = Math.max(1, Math.ceil(found.total / PAGE));
    const turn = (to, words) => (to >= 1 && to <= last ? el("a", { href: app.href({ page: to > 1 ? to : undefined }), "data-top": true }, words) : el("span", { class: "off" }, words));
    fill(pages, found.total > 0 && [turn(page - 1, "‹ before"), ` ${(page - 1) * PAGE + 1} to ${Math.min(page * PAGE, found.total)} of ${found.total} `, turn(page + 1, "next ›")]);
    fill(notes, found.duties.length > 0 && el("dl", { class: "duties" }, found.duties.map((one) => [el("dt", {}, one.action), el("dd", {}, one.obliges_to)])),
      warnings(found.notes));
  }

  return {
    async update(state) {
      app.busy(true);
      filters(state);
      const page = Math.max(1, Math.round(state.page || 1));
      const [drawn, found] = await Promise.all([
        ask("schematic", { ...app.where(), bins: 400 }),
        ask("defects", { ...app.where(), band: state.only, from: state.from, to: state.to, least: state.least, order: state.order === "along" ? "along" : "gravest", offset: (page - 1) * PAGE, count: PAGE }),
      ]);
      bins = drawn.bins;
      summary(found);
      list(found);
      draw();
      app.busy(false);
    },
    draw,
  };
}
