// What the data are worth: days with passes, how much of the line each one tells and how well, and where it came from.

import { ask } from "./api.js";
import { choice, el, fill, table, warnings } from "./dom.js";
import { drawCoverage, readCoverage } from "./coverage.js";
import { ACTIONS, counted, dayNumber, dayOf, km, number, share } from "./words.js";

const WEEKS = 53;

export function mount(root, app) {
  const canvas = el("canvas", { class: "coverage", role: "img", "aria-label": "What each pass knows along the line" });
  const tools = el("div", { class: "tools" }), calendar = el("div", {}), rows = el("div", {}), about = el("div", {}), reading = el("output", { class: "reading short" }), key = el("p", { class: "hint" });
  let found = null;
  fill(root, el("h1", {}, "Data quality"), el("h2", {}, "Days with passes"), calendar, el("h2", {}, "Along the line"), tools, canvas, reading, key, el("h2", {}, "Passes"), rows, el("h2", {}, "The chosen pass"), about);
  canvas.addEventListener("pointermove", (event) => found && fill(reading, readCoverage(canvas, found, app.whole(), event)));

  function days() {
    const there = app.days, known = new Set(there.map(dayNumber));
    const last = dayNumber(there[there.length - 1]), first = Math.max(dayNumber(there[0]), last - 7 * WEEKS);
    const monday = first - ((first + 3) % 7), cells = [], months = [[1, dayOf(monday).slice(0, 7)]];
    for (let day = monday; day <= last; day++) {
      const week = Math.floor((day - monday) / 7) + 1;
      if (dayOf(day).endsWith("-01") && week > months[months.length - 1][0] + 3) months.push([week, dayOf(day).slice(0, 7)]);
      const passed = known.has(day), words = `${dayOf(day)}: ${passed ? "passed" : "no pass"}`;
      cells.push(passed ? el("a", { class: "day has", href: app.href({ day: dayOf(day), entry: undefined }), title: words, "aria-label": words, "aria-current": dayOf(day) === app.state.day ? "date" : undefined }) : el("span", { class: "day", title: words }));
    }
    const gaps = there.slice(1).map((day, i) => [dayNumber(day) - dayNumber(there[i]), there[i], day]).sort((a, b) => b[0] - a[0]);
    fill(calendar, el("div", { class: "calendar-frame" }, el("div", { class: "weekdays", "aria-hidden": "true" }, ["Mo", "", "We", "", "Fr", "", "Su"].map((one) => el("span", {}, one))),
      el("div", {}, el("div", { class: "months", "aria-hidden": "true" }, months.map(([week, name]) => placed(el("span", {}, name), week))), el("div", { class: "calendar" }, cells))),
    el("p", { class: "hint" }, `${counted(there.length, "day")} with passes, ${there[0]} to ${there[there.length - 1]}`,
      gaps.length > 0 && `; the longest time without one: ${gaps[0][1]} to ${gaps[0][2]} (${counted(gaps[0][0], "day")})`, "."));
  }

  function placed(node, week) {
    node.style.gridColumnStart = String(week);
    return node;
  }

  function list() {
    const bands = app.bands.map((one) => one.name);
    const heads = [{ name: "Date" }, { name: "Pass", minor: true }, { name: "From, to km" }, { name: "Known", number: true }, ...bands.map((one) => ({ name: `± ${one}, mm`, number: true })), { name: "Flags", long: true }, { name: "Calls for", long: true }];
    fill(rows, table(heads, [...found.passes].reverse().map((one) => ({
      mark: one.day === app.state.day ? "chosen" : "",
      cells: [
        el("a", { href: app.href({ day: one.day, entry: found.passes.filter((other) => other.day === one.day).length > 1 ? one.entry : undefined }) }, one.day), [one.run, one.vehicle].filter(Boolean).join(", "),
        `${number(one.start_m / 1000, 1)} to ${number(one.end_m / 1000, 1)}`, { number: share(one.known_share) },
        ...bands.map((band) => ({ number: one.deviation_mm[band] === undefined ? "not stated" : number(1.96 * one.deviation_mm[band], 2) })),
        one.flags.length ? one.flags.map((flag) => `${flag.name} ${share(flag.share)}`).join(", ") : "none",
        ACTIONS.filter((each) => one.counts[each.key]).map((each) => `${one.counts[each.key]} ${each.short}`).join(", ") || "nothing",
      ],
    })), { label: "Passes, the latest first; ± is half of the median 95 % interval", id: "quality" }));
  }

  function origin() {
    const ones = app.passes, one = ones.find((each) => each.entry === app.state.entry) || ones[0];
    const lines = [["Date", one.day], ["Run", one.run], ["Vehicle", one.vehicle], ["Track", one.track], ["Method", one.method], ["Prior", one.prior], ["Limits", one.limits], ["Line speed", one.speed_km_h ? `${number(one.speed_km_h, 0)} km/h` : ""],
      ["From, to", `${km(one.start_m)} to ${km(one.end_m)}`], ["Source", one.source], ["Recording (SHA-256)", one.recording], ["Entry", one.entry], ["Made by", one.software]];
    fill(about, el("dl", { class: "origin" }, lines.filter(([, text]) => text).map(([head, text]) => [el("dt", {}, head), el("dd", {}, text)])),
      warnings(one.notes));
  }

  function draw() {
    if (!found) return;
    canvas.style.height = `${Math.min(600, 14 * Math.max(1, found.passes.length) + 26)}px`;
    drawCoverage(canvas, found, app.whole(), app.state.day);
  }

  return {
    async update(state) {
      app.busy(true);
      days();
      fill(tools, choice("Band", app.bands.map((one) => [one.name, `${one.name}, ${one.shortest_m}–${one.longest_m} m`]), state.band, (band) => app.go({ band })));
      found = await ask("quality", { line: state.line, direction: state.direction, band: state.band, bins: 300 });
      fill(key, "Colour: half of the 95 % interval in the band, ", el("i", { class: "key-sure" }), " the least to ", el("i", { class: "key-unsure" }), " four times that and more; ", el("i", { class: "key-unknown" }), " not known.",
        found.omitted > 0 && ` The latest ${found.passes.length} of ${found.passes.length + found.omitted} passes.`);
      fill(reading);
      list();
      origin();
      draw();
      app.busy(false);
    },
    draw,
  };
}
