// Two dates against each other: both levels, their difference with its 95 % band, and the places that changed.

import { ask } from "./api.js";
import { choice, el, fill, table, warnings } from "./dom.js";
import { boxOf } from "./plot.js";
import { MARGINS, drawStrip, valueAt } from "./strips.js";
import { tileOf } from "./tiles.js";
import { handle, held, moved } from "./window.js";
import { between, half, km, number, signed, span } from "./words.js";

const WAIT = 200;

export function mount(root, app) {
  const canvas = (name) => el("canvas", { class: "strip", role: "img", "aria-label": name });
  const both = canvas("Level on both dates"), difference = canvas("Difference between the dates with its 95 % interval");
  const tools = el("div", { class: "tools" }), said = el("div", {}), rows = el("div", {}), range = el("output", { class: "range" }), reading = el("output", { class: "reading" });
  const ofBoth = el("h2", { class: "strip-name" }), ofDifference = el("h2", { class: "strip-name" });
  let view = null, found = null, timer = 0, stop = null;

  const port = {
    view: () => view, whole: () => app.whole(), box: () => boxOf(both.clientWidth, 1, MARGINS),
    show: (next) => {
      view = next;
      requestAnimationFrame(draw);
      app.busy(true);
      clearTimeout(timer);
      timer = setTimeout(() => {
        app.note({ from: view[0], to: view[1] });
        load().catch((error) => error.name !== "AbortError" && (app.say(error.message), app.busy(false)));
      }, WAIT);
    },
    point: read, pick: (place) => { app.note({ at: place }); draw(); },
  };
  const charts = el("section", { id: "charts", tabindex: 0, "aria-label": "Two dates: + and − zoom, arrows move", onkeydown: (event) => {
    const next = event.ctrlKey || event.metaKey || event.altKey ? null : moved(event.key, view, app.whole());
    if (!next) return;
    event.preventDefault();
    port.show(next);
  } }, ofBoth, both, ofDifference, difference);
  const step = (name, sign, key) => el("button", { type: "button", "aria-label": name, title: name, onclick: () => port.show(moved(key, view, app.whole())) }, sign);
  const alone = el("p", { hidden: true }, "There are passes of one date only: nothing to compare with.");
  const content = el("div", {}, tools,
    el("div", { class: "tools" }, step("to the left", "←", "ArrowLeft"), step("to the right", "→", "ArrowRight"), step("closer", "+", "+"), step("wider", "−", "-"), step("the whole line", "all", "Home"), range),
    reading, charts, rows, said);
  fill(root, el("h1", {}, "Two dates"), alone, content);
  for (const one of [both, difference]) handle(one, port);

  function controls(state) {
    const days = app.days.filter((one) => one !== state.day).reverse();
    fill(tools,
      choice("Compare with", days.map((one) => [one, one]), state.other, (other) => app.go({ other })),
      choice("Band", app.bands.map((one) => [one.name, `${one.name}, ${one.shortest_m}–${one.longest_m} m`]), state.band, (band) => app.go({ band })));
  }

  function draw() {
    if (!found || !view) return;
    const { band } = found, limits = found.second.limits;
    drawStrip(both, { strip: found.second, beside: found.first, view, limits, pinned: app.state.at, bare: true });
    drawStrip(difference, { strip: found.difference, view, pinned: app.state.at });
    range.textContent = `${km(view[0])} to ${km(view[1])} (${span(view[1] - view[0])})`;
    fill(ofBoth, band, el("span", {}, "level in mm: "), el("span", { class: "whole" }, el("i", { class: "key-line" }), found.second_day), el("span", { class: "whole" }, el("i", { class: "key-beside" }), found.first_day));
    fill(ofDifference, found.by_section ? "Change of the standard deviation" : "Difference",
      el("span", {}, found.by_section ? `per ${found.by_section} m, ${found.second_day} less ${found.first_day}, in mm; zoom to ${span(found.closest_m)} or less for the difference itself` : `${found.second_day} less ${found.first_day}, aligned, in mm with its 95 % interval; down is settlement`));
    read(null);
  }

  function read(place) {
    if (!found) return;
    const at = place ?? app.state.at ?? (view[0] + view[1]) / 2;
    const words = (strip) => {
      const one = valueAt(strip, at);
      return one ? between(one) : "not known";
    };
    fill(reading, el("strong", {}, km(at)), el("span", {}, `${found.second_day}: ${words(found.second)}`), el("span", {}, `${found.first_day}: ${words(found.first)}`),
      el("span", {}, `${found.by_section ? "change" : "difference"}: ${words(found.difference)}`));
  }

  function changes() {
    const heads = [{ name: "Place" }, { name: "Change, mm", number: true }, { name: "In 30 days, mm", number: true }, { name: "Level, mm", number: true, minor: true }, { name: "Next limit" }, { name: "Follow" }];
    fill(said, warnings(found.notes));
    if (found.by_section) return fill(rows);
    fill(rows, found.places.length ? table(heads, found.places.map((one) => {
      const next = one.reached.find((each) => each.median);
      return { cells: [
        el("a", { href: app.href({ from: Math.max(app.whole()[0], one.peak_m - 50), to: Math.min(app.whole()[1], one.peak_m + 50), at: one.peak_m }) }, km(one.peak_m)),
        { number: signed(one.change_mm) + half(one.deviation_mm) },
        { number: one.per_day_mm === null ? "–" : signed(30 * one.per_day_mm) + half(30 * one.per_day_deviation_mm) },
        { number: number(one.level_mm) }, next ? `${next.action} on ${next.median}` : "not within ten years",
        el("a", { href: app.href({ view: "place", at: one.peak_m }), "data-top": true, "aria-label": `development at ${km(one.peak_m)}` }, "development"),
      ] };
    }), { label: "Places that changed", id: "changes" }) : el("p", {}, "Nothing changed here beyond what the passes' uncertainty explains."));
  }

  async function load() {
    app.busy(true);
    stop?.abort();
    stop = new AbortController();
    const { other, band } = app.state, width = 2 * Math.max(200, Math.round(port.box().width)), tile = tileOf(view, app.whole(), width);
    found = await ask("compare", { ...app.where(), other, band, from: tile.from, to: tile.to, width: tile.width || width }, stop.signal);
    draw();
    changes();
    app.busy(false);
  }

  return {
    async update(state) {
      const whole = app.whole(), { days } = app;
      alone.hidden = days.length > 1;
      content.hidden = !alone.hidden;
      if (content.hidden) return app.busy(false);
      if (!days.includes(state.other) || state.other === state.day) {
        const before = days.filter((one) => one < state.day);
        return app.go({ other: before.length ? before[before.length - 1] : days.find((one) => one !== state.day) }, { replace: true });
      }
      controls(state);
      view = held([state.from ?? whole[0], state.to ?? whole[1]], whole);
      clearTimeout(timer);
      await load();
    },
    draw,
    leave() { stop?.abort(); clearTimeout(timer); },
  };
}
