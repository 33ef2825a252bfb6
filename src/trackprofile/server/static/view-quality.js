// Data quality: days with passes, how much of the line each pass covers and with what uncertainty, and its origin.

import { request } from "./api.js";
import { drawCoverage, coverageText } from "./coverage.js";
import { bandChoice, caveats, el, fill, table } from "./dom.js";
import { ACTIONS } from "./shared/actions.js";
import { HALF_WIDTH_95, counted, dateText, dayNumber, km, number, share } from "./shared/format.js";

const WEEKS = 53, BINS = 300, ROW_PX = 14, MAX_HEIGHT_PX = 600, AXIS_PX = 26;

export function mount(root, app) {
  const canvas = el("canvas", { class: "coverage", role: "img", "aria-label": "Standard deviation of each pass along the line" });
  const tools = el("div", { class: "tools" }), calendar = el("div", {}), rows = el("div", {}), origin = el("div", {}), reading = el("output", { class: "reading short" }), key = el("p", { class: "hint" });
  let quality = null;
  fill(root, el("h1", {}, "Data quality"), el("h2", {}, "Days with passes"), calendar, el("h2", {}, "Along the line"), tools, canvas, reading, key, el("h2", {}, "Passes"), rows, el("h2", {}, "The chosen pass"), origin);
  canvas.addEventListener("pointermove", (event) => quality && fill(reading, coverageText(canvas, quality, app.whole(), event)));

  function fillCalendar() {
    const { days } = app, passed = new Set(days.map(dayNumber));
    const last = dayNumber(days[days.length - 1]), first = Math.max(dayNumber(days[0]), last - 7 * WEEKS);
    const monday = first - ((first + 3) % 7), cells = [], months = [[1, dateText(monday).slice(0, 7)]];
    for (let day = monday; day <= last; day++) {
      const week = Math.floor((day - monday) / 7) + 1, date = dateText(day);
      if (date.endsWith("-01") && week > months[months.length - 1][0] + 3) months.push([week, date.slice(0, 7)]);
      const title = `${date}: ${passed.has(day) ? "passes" : "no pass"}`;
      cells.push(passed.has(day) ? el("a", { class: "day has", href: app.href({ day: date, entry: undefined }), title, "aria-label": title, "aria-current": date === app.state.day ? "date" : undefined }) : el("span", { class: "day", title }));
    }
    fill(calendar, el("div", { class: "calendar-frame" }, el("div", { class: "weekdays", "aria-hidden": "true" }, ["Mo", "", "We", "", "Fr", "", "Su"].map((one) => el("span", {}, one))),
      el("div", {}, el("div", { class: "months", "aria-hidden": "true" }, months.map(([week, name]) => inColumn(el("span", {}, name), week))), el("div", { class: "calendar" }, cells))),
    el("p", { class: "hint" }, calendarText(days)));
  }

  function row(pass) {
    const { day, entry, run, vehicle, standard_deviation_mm: deviations, flags, defect_counts: counts } = pass;
    const isOnlyOne = quality.passes.filter((other) => other.day === day).length === 1;
    return {
      mark: day === app.state.day ? "chosen" : "",
      cells: [
        el("a", { href: app.href({ day, entry: isOnlyOne ? undefined : entry }) }, day), [run, vehicle].filter(Boolean).join(", "),
        `${number(pass.start_m / 1000, 1)} to ${number(pass.end_m / 1000, 1)}`, { number: share(pass.known_share) },
        ...app.bands.map((band) => ({ number: deviations[band.name] === undefined ? "not stated" : number(HALF_WIDTH_95 * deviations[band.name], 2) })),
        flags.length ? flags.map((flag) => `${flag.name} ${share(flag.share)}`).join(", ") : "none",
        ACTIONS.filter((action) => counts[action.key]).map((action) => `${counts[action.key]} ${action.short}`).join(", ") || "none",
      ],
    };
  }

  function fillTable() {
    const heads = [{ name: "Date" }, { name: "Pass", minor: true }, { name: "From, to km" }, { name: "Known", number: true }, ...app.bands.map((band) => ({ name: `± ${band.name}, mm`, number: true })), { name: "Flags", long: true }, { name: "Required actions", long: true }];
    fill(rows, table(heads, [...quality.passes].reverse().map(row), { label: "Passes, the latest first; ± is half of the median 95 % interval", id: "quality" }));
  }

  function fillOrigin() {
    const pass = app.passes.find((one) => one.entry === app.state.entry) || app.passes[0];
    const lines = [["Date", pass.day], ["Run", pass.run], ["Vehicle", pass.vehicle], ["Track", pass.track], ["Method", pass.method], ["Prior", pass.prior], ["Limits", pass.limit_set], ["Line speed", pass.line_speed_km_h ? `${number(pass.line_speed_km_h, 0)} km/h` : ""],
      ["From, to", `${km(pass.start_m)} to ${km(pass.end_m)}`], ["Source", pass.source], ["Recording (SHA-256)", pass.recording], ["Entry", pass.entry], ["Software", pass.software]];
    fill(origin, el("dl", { class: "origin" }, lines.filter(([, text]) => text).map(([head, text]) => [el("dt", {}, head), el("dd", {}, text)])), caveats(pass.notes));
  }

  function draw() {
    if (!quality) return;
    canvas.style.height = `${Math.min(MAX_HEIGHT_PX, ROW_PX * Math.max(1, quality.passes.length) + AXIS_PX)}px`;
    drawCoverage(canvas, quality, app.whole(), app.state.day);
  }

  return {
    async update(state) {
      app.setBusy(true);
      fillCalendar();
      fill(tools, bandChoice(app));
      quality = await request("quality", { line: state.line, direction: state.direction, band: state.band, bins: BINS });
      fill(key, "Colour: half of the 95 % interval in the band, ", el("i", { class: "key-certain" }), " the lowest to ", el("i", { class: "key-uncertain" }), " four times the lowest or more; ", el("i", { class: "key-unknown" }), " not known.",
        quality.omitted_passes > 0 && ` The latest ${quality.passes.length} of ${quality.passes.length + quality.omitted_passes} passes.`);
      fill(reading);
      fillTable();
      fillOrigin();
      draw();
      app.setBusy(false);
    },
    draw,
  };
}

/** "4 days with passes, ...; the longest interval without one: ..." */
export function calendarText(days) {
  const gaps = days.slice(1).map((day, i) => [dayNumber(day) - dayNumber(days[i]), days[i], day]).sort((a, b) => b[0] - a[0]);
  const longest = gaps.length ? `; the longest interval without one: ${gaps[0][1]} to ${gaps[0][2]} (${counted(gaps[0][0], "day")})` : "";
  return `${counted(days.length, "day")} with passes, ${days[0]} to ${days[days.length - 1]}${longest}.`;
}

function inColumn(node, column) {
  node.style.gridColumnStart = String(column);
  return node;
}
