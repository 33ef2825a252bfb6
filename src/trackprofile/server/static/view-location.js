// One location over time: its level on each day with a forecast, and its surroundings pass by pass.

import { request } from "./api.js";
import { bandChoice, button, caveats, chartBox, choice, el, fill, kilometreForm, table } from "./dom.js";
import { developmentChart, surroundingsChart } from "./location-charts.js";
import { HALF_WIDTH_95, dayNumber, km, number, plusMinus, signed } from "./shared/format.js";

const MARGIN_M = 100; // to each side of the location that a link shows
const MONTH_DAYS = 30;
const HEADS = [{ name: "Date" }, { name: "Pass", minor: true }, { name: "Level, mm", number: true }, { name: "See" }];

export function mount(root, app) {
  const overTime = chartBox("Level of the location over time, with its trend and forecast", "tall");
  const around = chartBox("Level around the location, pass by pass");
  const summary = el("div", { class: "first" }), tools = el("div", { class: "tools" }), rows = el("div", {}), title = el("h1", {});
  const timeTitle = el("h2", { class: "strip-name" }), aroundTitle = el("h2", { class: "strip-name" });
  let charts = [];
  fill(root, title, tools, summary, timeTitle, overTime, aroundTitle, around, rows);

  function clear() {
    for (const chart of charts) chart?.destroy();
    charts = [];
    for (const node of [summary, rows, timeTitle, aroundTitle]) fill(node);
  }

  function fillTools(state, at) {
    const [start, end] = app.whole();
    const step = (by, sign) => button(`${Math.abs(by)} m ${by < 0 ? "back" : "forward"}`, sign, () => app.go({ at: at + by }));
    fill(tools,
      kilometreForm({ name: "kilometre of the location", value: (at / 1000).toFixed(3), whole: app.whole, go: (distance) => app.go({ at: distance }), refuse: app.report }),
      step(-1, "−1 m"), step(1, "+1 m"), bandChoice(app),
      choice("Passes since", [["", "the first"], ...app.days.slice(1, -1).map((day) => [day, day])], state.since || "", (since) => app.go({ since: since || undefined })),
      el("a", { href: app.href({ view: "line", at, from: Math.max(start, at - MARGIN_M), to: Math.min(end, at + MARGIN_M) }) }, "show on the line"));
  }

  function fillTable(development) {
    const { at_m: at, passes, level_mm: levels, standard_deviation_mm: deviations, excluded, notes } = development;
    const link = (pass) => el("a", { href: app.href({ view: "line", day: pass.day, entry: pass.entry, at, from: at - MARGIN_M, to: at + MARGIN_M }) }, "on the line");
    const cells = passes.map((pass, i) => ({ cells: [pass.day, pass.run || pass.vehicle, { number: number(levels[i]) + plusMinus(deviations[i]) }, link(pass)] }));
    fill(rows, table(HEADS, cells.reverse(), { label: "Passes used", id: "passes" }),
      excluded.length > 0 && [el("h2", {}, "Passes not used"), el("ul", {}, excluded.map((one) => el("li", {}, `${one.day}${one.run ? ` ${one.run}` : ""}: ${one.reason}`)))], caveats(notes));
  }

  function fillTitles({ band, passes }) {
    const first = passes[0].day, last = passes[passes.length - 1].day;
    fill(timeTitle, band, el("span", {}, "level over time in mm, each pass with its 95 % interval; trend and forecast with theirs"));
    fill(aroundTitle, "Surroundings", el("span", {}, `level in mm, ${first === last ? last : `${first} to ${last}, later passes darker`}`));
    overTime.dataset.days = String(dayNumber(last) - dayNumber(first));
  }

  /** The location to show if the address names none: the most severe defect of the stretch that was shown last. */
  async function mostSevere({ from, to }) {
    const answer = await request("defects", { ...app.selection(), from, to, count: 1 });
    return answer.defects[0]?.peak_m;
  }

  return {
    async update(state) {
      const [start, end] = app.whole(), at = Math.max(start, Math.min(end, state.at ?? (await mostSevere(state)) ?? (start + end) / 2));
      app.setBusy(true);
      if (state.at !== at) app.note({ at });
      fill(title, `Development at ${km(at)}`);
      fillTools(state, at);
      clear();
      const development = await request("development", { line: state.line, direction: state.direction, band: state.band, at, since: state.since });
      clear();
      fillTitles(development);
      fill(summary, el("ul", {}, sentences(development).map((one) => el("li", {}, one))));
      fillTable(development);
      charts = [developmentChart(overTime, development), surroundingsChart(around, development)];
      app.setBusy(false);
    },
    leave: clear,
  };
}

/** The development in sentences. */
export function sentences(development) {
  const { trend, level_mm: levels, passes, excluded, omitted_passes: omitted } = development, used = passes.length + excluded.length;
  const list = trend ? trendSentences(development, trend, levels[levels.length - 1]) : ["All passes are of one day, or there is only one: the rate of change cannot be determined."];
  if (omitted) list.push(`${used} of ${used + omitted} passes are used, evenly distributed over the time.`);
  return list;
}

function trendSentences({ exceeded_limits: exceeded, limit_crossings: crossings }, trend, level) {
  const month = MONTH_DAYS * trend.rate_mm_per_day, half = HALF_WIDTH_95 * MONTH_DAYS * trend.rate_standard_deviation_mm_per_day;
  const verb = level * month > 0 ? "increases" : "decreases";
  const list = [Math.abs(month) > half ? `The height ${verb} by ${number(Math.abs(month))} ± ${number(half)} mm in 30 days.` : `No significant change: ${signed(month)} ± ${number(half)} mm in 30 days.`];
  if (!trend.is_linear) list.push("The passes do not lie on a straight line: if maintenance was done, choose the passes since then.");
  for (const one of exceeded.slice(-1)) list.push(`The limit of ${one.action} (${one.height_mm} mm) is exceeded.`);
  for (const one of crossings) {
    if (one.median) list.push(`If the trend continues, the limit of ${one.action} (${one.height_mm} mm) is reached on ${one.median}; 95 % interval ${one.earliest} to ${one.latest || "later than in ten years"}.`);
  }
  return list;
}
