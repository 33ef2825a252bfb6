// The line on a day: schematic, strips of all bands with their 95 % band, standard deviations per section.

import { ask } from "./api.js";
import { el, fill } from "./dom.js";
import { boxOf } from "./plot.js";
import { drawSchematic, pickOn } from "./schematic.js";
import { MARGINS, drawSections, drawStrip, reasonsAt, valueAt } from "./strips.js";
import { tileOf, covers } from "./tiles.js";
import { handle, held, moved } from "./window.js";
import { between, km, number, span } from "./words.js";

const WAIT = 90; // ms after the last move before finer data are asked for

export function mount(root, app) {
  const canvas = (name, kind) => el("canvas", { class: kind, role: "img", "aria-label": name });
  const schematic = canvas("Places along the line that call for something", "schematic");
  const strips = app.bands.map((band) => ({ band, canvas: canvas(`Level in ${band.name} with its 95 % interval`, "strip"), whole: null, tile: null }));
  const sections = canvas("Standard deviation per section", "low");
  const ofSections = el("span", {});
  const range = el("output", { class: "range" }), reading = el("output", { class: "reading" }), picked = el("span", { class: "picked" });
  const field = el("input", { type: "text", inputmode: "decimal", size: 8, "aria-label": "kilometre to go to", placeholder: "12.345" });
  let view = null, asked = "", marks = { bins: [], defects: [], sections: [], limits: {} }, bar = null, timer = 0, stop = null, saving = 0;

  const step = (name, sign, keyName) => el("button", { type: "button", "aria-label": name, title: name, onclick: () => { const next = moved(keyName, view, app.whole()); show(next); save(); } }, sign);
  const tools = el("div", { class: "tools" },
    step("to the left", "←", "ArrowLeft"), step("to the right", "→", "ArrowRight"), step("closer", "+", "+"), step("wider", "−", "-"), step("the whole line", "all", "Home"),
    el("form", { class: "jump", onsubmit: (event) => { event.preventDefault(); jump(); } }, el("label", {}, "km ", field), el("button", { type: "submit" }, "go")),
    range, picked);
  const charts = el("section", { id: "charts", tabindex: 0, "aria-label": "Strip charts: + and − zoom, arrows move, Home shows the whole line", onkeydown: keyed },
    strips.map(({ band, canvas: one }) => [el("h2", { class: "strip-name" }, band.name, el("span", {}, `${band.shortest_m} to ${band.longest_m} m, level in mm`)), one]),
    el("h2", { class: "strip-name" }, "Standard deviation", ofSections), sections);
  fill(root, schematic, tools, reading, charts,
    el("p", { class: "hint" }, "Wheel, + and − or two fingers zoom; dragging or the arrow keys move; a click marks a place. ",
      el("span", { class: "key-line" }), " level (where one pixel holds many metres, from its least to its greatest value) ", el("span", { class: "key-band" }), " 95 % band ",
      el("span", { class: "key-unknown" }), " not known ", el("span", { class: "key-unjudged" }), " not judged"));

  const port = {
    view: () => view, whole: () => app.whole(), box: () => boxOf(strips[0].canvas.clientWidth, 1, MARGINS),
    show: (next) => { show(next); save(); },
    point: (place) => read(place),
    pick: (place) => { app.note({ at: place }); draw(); },
  };
  for (const one of [...strips.map((each) => each.canvas), sections]) handle(one, port);
  pickOn(schematic, () => bar, () => app.whole(), (place, done) => {
    const [start, end] = app.whole(), length = Math.min(view[1] - view[0], (end - start) / 20);
    show(held([place - length / 2, place + length / 2], app.whole()));
    if (done) app.go({ from: view[0], to: view[1] });
  });

  function keyed(event) {
    const next = event.ctrlKey || event.metaKey || event.altKey ? null : moved(event.key, view, app.whole());
    if (!next) return;
    event.preventDefault();
    show(next);
    save();
  }

  function jump() {
    const place = Number(field.value.replace(",", ".").replace(/^\s*km/i, "")) * 1000;
    const [start, end] = app.whole();
    if (!field.value.trim() || !(place >= start && place <= end)) {
      app.say(`Type a kilometre from ${number(start / 1000, 3)} to ${number(end / 1000, 3)}.`);
      return;
    }
    const next = held([place - 500, place + 500], app.whole());
    app.go({ from: next[0], to: next[1], at: place });
  }

  /** Shows a stretch at once from what is here; finer data follow. */
  function show(next) {
    view = next;
    requestAnimationFrame(() => draw());
    clearTimeout(timer);
    timer = setTimeout(() => load().catch(failed), WAIT);
    app.busy(true);
  }

  function save() {
    clearTimeout(saving);
    const isWhole = view[1] - view[0] > 0.9999 * (app.whole()[1] - app.whole()[0]);
    saving = setTimeout(() => { app.note({ from: isWhole ? undefined : view[0], to: isWhole ? undefined : view[1] }); draw(); }, 250);
  }

  const failed = (error) => { if (error.name !== "AbortError") { app.say(error.message); app.busy(false); } };
  const best = (one) => (one.tile && covers(one.tile, view) ? one.tile : one.whole);

  async function load() {
    stop?.abort();
    stop = new AbortController();
    const { signal } = stop, where = app.where(), whole = app.whole(), width = 2 * Math.max(200, Math.round(port.box().width));
    const tile = tileOf(view, whole, width), [from, to] = [tile.from, tile.to];
    const wanted = strips.map(async (one) => {
      if (!one.whole) one.whole = await ask("strip", { ...where, band: one.band.name, from: whole[0], to: whole[1], width }, signal);
      if (tile.width) one.tile = await ask("strip", { ...where, band: one.band.name, from, to, width: tile.width }, signal);
      requestAnimationFrame(() => draw());
    });
    const others = [
      ask("schematic", { ...where, bins: 400 }, signal).then((found) => { marks.bins = found.bins; }),
      ask("defects", { ...where, from, to, count: 500 }, signal).then((found) => { marks.defects = found.total > found.defects.length ? [] : found.defects; }),
      ask("sections", { ...where, band: strips[0].band.name, from, to, count: Math.max(50, Math.round(width / 8)) }, signal).then((found) => { marks.sections = found.sections; ofSections.textContent = sectionsName(found); }),
    ];
    await Promise.all([...wanted, ...others]);
    draw();
    app.busy(false);
  }

  function sectionsName(found) {
    if (!found.length_m) return "none stored";
    const grouped = found.grouped > 1 ? `, the worst of every ${found.grouped} sections` : "";
    return `of ${found.band} per ${found.length_m} m in mm, with its 95 % interval${grouped}`;
  }

  function draw(next = view) {
    view = next;
    if (!view || !root.contains(charts)) return;
    const pinned = app.state.at;
    bar = drawSchematic(schematic, { whole: app.whole(), view, bins: marks.bins });
    for (const one of strips) {
      const strip = best(one);
      drawStrip(one.canvas, { strip, view, limits: strip?.limits || [], defects: marks.defects.filter((each) => each.band === one.band.name), pinned });
    }
    drawSections(sections, { sections: marks.sections, view });
    range.textContent = `${km(view[0])} to ${km(view[1])} (${span(view[1] - view[0])})`;
    fill(picked, pinned !== undefined && ["marked ", km(pinned), ": ",
      el("a", { href: app.href({ view: "place" }) }, "its development"), " · ",
      el("a", { href: app.href({ view: "compare", from: Math.max(app.whole()[0], pinned - 100), to: Math.min(app.whole()[1], pinned + 100) }) }, "two dates there")]);
    read(null);
  }

  /** The values under the pointer; at the middle where there is none. */
  function read(place) {
    const at = place ?? app.state.at ?? (view[0] + view[1]) / 2;
    if (place !== null && (at < view[0] || at > view[1])) return;
    const parts = strips.map((one) => {
      const found = valueAt(best(one), at);
      if (!found) return `${one.band.name} not known`;
      const why = reasonsAt(best(one), at);
      return `${one.band.name} ${between(found)}${why && ` (not judged: ${why})`}`;
    });
    fill(reading, el("strong", {}, km(at)), parts.map((text) => el("span", {}, text)));
  }

  return {
    async update(state) {
      const { line, direction, day, entry } = app.where(), now = JSON.stringify([line, direction, day, entry]), whole = app.whole();
      if (now !== asked) {
        marks = { ...marks, bins: [], defects: [], sections: [] };
        for (const one of strips) one.whole = one.tile = null;
      }
      const next = held([state.from ?? whole[0], state.to ?? whole[1]], whole);
      clearTimeout(timer);
      clearTimeout(saving);
      draw(next);
      asked = now;
      app.busy(true);
      await load();
    },
    draw: () => draw(),
    leave() { stop?.abort(); clearTimeout(timer); clearTimeout(saving); },
  };
}
