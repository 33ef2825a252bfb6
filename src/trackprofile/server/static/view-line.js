// The line on a day: schematic, levels of all bands with their 95 % intervals, standard deviations per section.

import { request } from "./api.js";
import { button, chartBox, el, fill, kilometreForm } from "./dom.js";
import { levelChart, sectionChart } from "./shared/charts.js";
import { levelAt } from "./shared/envelope.js";
import { km, kmDigits, lengthText, levelText } from "./shared/format.js";
import { addPicking, drawSchematic } from "./shared/schematic.js";
import { BUTTONS, afterKey, clamped } from "./shared/view.js";
import { covers, tileOf } from "./tiles.js";

const LOAD_DELAY_MS = 90, SAVE_DELAY_MS = 250; // after the last move
const MAX_DEFECTS = 500, SCHEMATIC_BINS = 400;
const NO_LIMITS = [];
const GROUP = "line"; // of charts that share the cursor
const chainage = (distance, step) => km(distance, kmDigits(step));

export function mount(root, app) {
  const schematic = el("canvas", { class: "schematic", role: "img", "aria-label": "Defects along the line" });
  const strips = app.bands.map((band) => ({ band, box: chartBox(`Level in ${band.name} with its 95 % interval`), chart: null, whole: null, tile: null, defects: [] }));
  const sections = { box: chartBox("Standard deviation per section", "low"), name: el("span", {}), chart: null };
  const range = el("output", { class: "range" }), reading = el("output", { class: "reading" }), marked = el("span", { class: "picked" });
  const marks = { schematic: [], sections: [] };
  let isWaiting = false, view = null, selection = "", bar = null, loading = 0, saving = 0, abort = null;

  const port = {
    view: () => view, whole: () => app.whole(), point: read,
    show: (next) => { show(next); save(); },
    pick: (distance) => { app.note({ at: distance }); draw(); },
  };
  const move = (key) => port.show(afterKey(key, view, app.whole()));
  const tools = el("div", { class: "tools" },
    BUTTONS.map(([key, name, sign]) => button(name, sign, () => move(key))),
    kilometreForm({ name: "kilometre to go to", whole: app.whole, refuse: app.report, go: (distance) => {
      const [from, to] = clamped([distance - 500, distance + 500], app.whole());
      app.go({ from, to, at: distance });
    } }), range, marked);
  const charts = el("section", { id: "charts", tabindex: 0, "aria-label": "Charts: + and − zoom, arrow keys move, Home shows the whole line", onkeydown: (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !afterKey(event.key, view, app.whole())) return;
    event.preventDefault();
    move(event.key);
  } },
  strips.map(({ band, box }) => [el("h2", { class: "strip-name" }, band.name, el("span", {}, `${band.shortest_m} to ${band.longest_m} m, level in mm`)), box]),
  el("h2", { class: "strip-name" }, "Standard deviation", sections.name), sections.box);
  fill(root, schematic, tools, reading, charts, hint());
  addPicking(schematic, () => bar, () => app.whole(), (distance, isLast) => {
    const [start, end] = app.whole(), length = Math.min(view[1] - view[0], (end - start) / 20);
    show(clamped([distance - length / 2, distance + length / 2], app.whole()));
    if (isLast) app.go({ from: view[0], to: view[1] });
  });

  /** Shows a stretch at once from loaded data; finer data follow. */
  function show(next) {
    view = next;
    drawSoon();
    clearTimeout(loading);
    loading = setTimeout(() => load().catch(app.reportFailure), LOAD_DELAY_MS);
    app.setBusy(true);
  }

  /** Draws once before the next frame, however often it is called. */
  function drawSoon() {
    if (isWaiting) return;
    isWaiting = true;
    requestAnimationFrame(() => { isWaiting = false; draw(); });
  }

  /** Writes the stretch into the address. */
  function save() {
    clearTimeout(saving);
    const isWhole = view[1] - view[0] > 0.9999 * (app.whole()[1] - app.whole()[0]);
    saving = setTimeout(() => { app.note({ from: isWhole ? undefined : view[0], to: isWhole ? undefined : view[1] }); draw(); }, SAVE_DELAY_MS);
  }

  function setDefects(defects) {
    for (const strip of strips) strip.defects = defects.filter((one) => one.band === strip.band.name);
  }

  const finest = (strip) => (strip.tile && covers(strip.tile, view) ? strip.tile : strip.whole);

  async function load() {
    abort?.abort();
    abort = new AbortController();
    const { signal } = abort, parameters = app.selection(), whole = app.whole(), pixels = 2 * Math.max(200, charts.clientWidth);
    const tile = tileOf(view, whole, pixels), { from, to } = tile;
    const levels = strips.map(async (strip) => {
      const band = strip.band.name;
      strip.whole ??= await request("level", { ...parameters, band, from: whole[0], to: whole[1], max_bins: pixels }, signal);
      if (tile.bins) strip.tile = await request("level", { ...parameters, band, from, to, max_bins: tile.bins }, signal);
      drawSoon();
    });
    const others = [
      request("schematic", { ...parameters, bins: SCHEMATIC_BINS }, signal).then((answer) => { marks.schematic = answer.bins; }),
      request("defects", { ...parameters, from, to, count: MAX_DEFECTS }, signal).then((answer) => { setDefects(answer.total > answer.defects.length ? [] : answer.defects); }),
      request("sections", { ...parameters, band: strips[0].band.name, from, to, count: Math.max(50, Math.round(pixels / 8)) }, signal).then((answer) => {
        marks.sections = answer.sections;
        sections.name.textContent = sectionsText(answer);
      }),
    ];
    await Promise.all([...levels, ...others]);
    draw();
    app.setBusy(false);
  }

  function draw(next = view) {
    view = next;
    if (!view || !root.contains(charts)) return;
    const pinned = app.state.at;
    bar = drawSchematic(schematic, { whole: app.whole(), view, marks: marks.schematic, chainage });
    for (const strip of strips) {
      strip.chart ??= levelChart(strip.box, { port, chainage, group: GROUP });
      const envelope = finest(strip);
      strip.chart.update({ envelope, view, limits: envelope?.limits || NO_LIMITS, defects: strip.defects, pinned });
    }
    sections.chart ??= sectionChart(sections.box, { port, chainage, group: GROUP });
    sections.chart.update({ sections: marks.sections, view });
    range.textContent = `${km(view[0])} to ${km(view[1])} (${lengthText(view[1] - view[0])})`;
    fill(marked, pinned !== undefined && markedLinks(app, pinned));
    read(null);
  }

  /** Shows the values under the pointer; without one, at the marked location or in the middle. */
  function read(distance) {
    const at = distance ?? app.state.at ?? (view[0] + view[1]) / 2;
    if (distance !== null && (at < view[0] || at > view[1])) return;
    const parts = strips.map((strip) => {
      const envelope = finest(strip), level = levelAt(envelope, at);
      if (!level) return `${strip.band.name} not known`;
      const reasons = envelope.not_assessed.find((one) => one.start_m <= at && at <= one.end_m)?.reasons;
      return `${strip.band.name} ${levelText(level)}${reasons ? ` (not assessed: ${reasons})` : ""}`;
    });
    fill(reading, el("strong", {}, km(at)), parts.map((text) => el("span", {}, text)));
  }

  return {
    async update(state) {
      const now = JSON.stringify(app.selection()), whole = app.whole();
      if (now !== selection) {
        Object.assign(marks, { schematic: [], sections: [] });
        setDefects([]);
        for (const strip of strips) strip.whole = strip.tile = null;
      }
      clearTimeout(loading);
      clearTimeout(saving);
      draw(clamped([state.from ?? whole[0], state.to ?? whole[1]], whole));
      selection = now;
      app.setBusy(true);
      await load();
    },
    draw: () => draw(),
    leave() { abort?.abort(); clearTimeout(loading); clearTimeout(saving); },
  };
}

function hint() {
  const key = (name, text) => [el("span", { class: `key-${name}` }), text];
  return el("p", { class: "hint" }, "Zoom with the wheel, + and −, or two fingers; move by dragging or with the arrow keys; click to mark a location. ",
    key("line", " level (range from minimum to maximum where a pixel covers many metres) "), key("band", " 95 % interval "), key("unknown", " not known "), key("not-assessed", " known, but not assessed. "),
    "Marks of required actions: square immediate action, diamond intervention, triangle alert, dot possible.");
}

function sectionsText({ length_m: length, group_size: group, band }) {
  if (!length) return "no sections stored";
  return `in ${band} per ${length} m, in mm, with its 95 % interval${group > 1 ? `; the worst of every ${group} sections` : ""}`;
}

function markedLinks(app, distance) {
  const [start, end] = app.whole();
  return ["marked ", km(distance), ": ", el("a", { href: app.href({ view: "location" }) }, "development over time"), " · ",
    el("a", { href: app.href({ view: "compare", from: Math.max(start, distance - 100), to: Math.min(end, distance + 100) }) }, "compare two dates")];
}
