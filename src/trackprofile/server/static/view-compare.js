// Two dates compared: both levels, their difference with its 95 % interval, and the locations that changed.

import { request } from "./api.js";
import { bandChoice, button, caveats, chartBox, choice, el, fill, table } from "./dom.js";
import { levelChart } from "./shared/charts.js";
import { levelAt } from "./shared/envelope.js";
import { km, kmDigits, lengthText, levelText, number, plusMinus, signed } from "./shared/format.js";
import { BUTTONS, afterKey, clamped } from "./shared/view.js";
import { tileOf } from "./tiles.js";

const LOAD_DELAY_MS = 200;
const GROUP = "compare"; // of charts that share the cursor
const HEADS = [{ name: "Location" }, { name: "Change, mm", number: true }, { name: "In 30 days, mm", number: true }, { name: "Level, mm", number: true, minor: true }, { name: "Next limit" }, { name: "See" }];
const MARGIN_M = 50; // to each side of a location that a link shows

export function mount(root, app) {
  const both = { box: chartBox("Level on both dates"), chart: null, title: el("h2", { class: "strip-name" }) };
  const difference = { box: chartBox("Difference between the dates with its 95 % interval"), chart: null, title: el("h2", { class: "strip-name" }) };
  const tools = el("div", { class: "tools" }), notes = el("div", {}), rows = el("div", {}), range = el("output", { class: "range" }), reading = el("output", { class: "reading" });
  let view = null, comparison = null, loading = 0, abort = null;

  const port = {
    view: () => view, whole: () => app.whole(), point: read,
    show: (next) => {
      view = next;
      requestAnimationFrame(draw);
      app.setBusy(true);
      clearTimeout(loading);
      loading = setTimeout(() => {
        app.note({ from: view[0], to: view[1] });
        load().catch(app.reportFailure);
      }, LOAD_DELAY_MS);
    },
    pick: (distance) => { app.note({ at: distance }); draw(); },
  };
  const move = (key) => port.show(afterKey(key, view, app.whole()));
  const charts = el("section", { id: "charts", tabindex: 0, "aria-label": "Two dates: + and − zoom, arrow keys move", onkeydown: (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !afterKey(event.key, view, app.whole())) return;
    event.preventDefault();
    move(event.key);
  } }, both.title, both.box, difference.title, difference.box);
  const oneDate = el("p", { hidden: true }, "There are passes of one date only: nothing to compare with.");
  const content = el("div", {}, tools, el("div", { class: "tools" }, BUTTONS.map(([key, name, sign]) => button(name, sign, () => move(key))), range), reading, charts, rows, notes);
  fill(root, el("h1", {}, "Two dates"), oneDate, content);

  function fillTools(state) {
    const days = app.days.filter((one) => one !== state.day).reverse();
    fill(tools, choice("Compare with", days.map((one) => [one, one]), state.compared_day, (day) => app.go({ compared_day: day })), bandChoice(app));
  }

  function draw() {
    if (!comparison || !view) return;
    const chainage = (distance, step) => km(distance, kmDigits(step)), pinned = app.state.at;
    both.chart ??= levelChart(both.box, { port, chainage, group: GROUP, bare: true, hasCompared: true });
    difference.chart ??= levelChart(difference.box, { port, chainage, group: GROUP });
    both.chart.update({ envelope: comparison.second, compared: comparison.first, view, limits: comparison.second.limits, pinned });
    difference.chart.update({ envelope: comparison.difference, view, pinned });
    range.textContent = `${km(view[0])} to ${km(view[1])} (${lengthText(view[1] - view[0])})`;
    read(null);
  }

  function fillTitles({ band, first_day: first, second_day: second, section_length_m: section, max_pointwise_length_m: longest }) {
    const key = (name, text) => el("span", { class: "whole" }, el("i", { class: `key-${name}` }), text);
    fill(both.title, band, el("span", {}, "level in mm: "), key("line", second), key("compared", first));
    fill(difference.title, section ? "Change of the standard deviation" : "Difference", el("span", {}, section
      ? `per ${section} m, ${second} minus ${first}, in mm; zoom to ${lengthText(longest)} or less for the difference of the levels`
      : `${second} minus ${first}, aligned, in mm with its 95 % interval; negative is settlement`));
  }

  function read(distance) {
    if (!comparison) return;
    const at = distance ?? app.state.at ?? (view[0] + view[1]) / 2;
    const text = (envelope) => {
      const level = levelAt(envelope, at);
      return level ? levelText(level) : "not known";
    };
    fill(reading, el("strong", {}, km(at)), el("span", {}, `${comparison.second_day}: ${text(comparison.second)}`), el("span", {}, `${comparison.first_day}: ${text(comparison.first)}`),
      el("span", {}, `${comparison.section_length_m ? "change" : "difference"}: ${text(comparison.difference)}`));
  }

  function row({ peak_m: at, change_mm: change, standard_deviation_mm: deviation, level_mm: level, rate_mm_per_day: rate, rate_standard_deviation_mm_per_day: rateDeviation, limit_crossings: crossings }) {
    const [start, end] = app.whole(), next = crossings.find((one) => one.median);
    return { cells: [
      el("a", { href: app.href({ from: Math.max(start, at - MARGIN_M), to: Math.min(end, at + MARGIN_M), at }) }, km(at)),
      { number: signed(change) + plusMinus(deviation) }, { number: rate === null ? "–" : signed(30 * rate) + plusMinus(30 * rateDeviation) },
      { number: number(level) }, next ? `${next.action} on ${next.median}` : "not within ten years",
      el("a", { href: app.href({ view: "location", at }), "data-top": true, "aria-label": `development at ${km(at)}` }, "development"),
    ] };
  }

  async function load() {
    app.setBusy(true);
    abort?.abort();
    abort = new AbortController();
    const { compared_day, band } = app.state, pixels = 2 * Math.max(200, charts.clientWidth), tile = tileOf(view, app.whole(), pixels);
    comparison = await request("compare", { ...app.selection(), compared_day, band, from: tile.from, to: tile.to, max_bins: tile.bins || pixels }, abort.signal);
    fillTitles(comparison);
    draw();
    const { locations } = comparison;
    fill(rows, comparison.section_length_m ? null : locations.length ? table(HEADS, locations.map(row), { label: "Locations that changed", id: "changes" }) : el("p", {}, "No significant change: the uncertainty of the passes explains all differences."));
    fill(notes, caveats(comparison.notes));
    app.setBusy(false);
  }

  return {
    async update(state) {
      const whole = app.whole(), { days } = app;
      oneDate.hidden = days.length > 1;
      content.hidden = !oneDate.hidden;
      if (content.hidden) return app.setBusy(false);
      if (!days.includes(state.compared_day) || state.compared_day === state.day) {
        const before = days.filter((one) => one < state.day);
        return app.go({ compared_day: before.length ? before[before.length - 1] : days.find((one) => one !== state.day) }, { replace: true });
      }
      fillTools(state);
      view = clamped([state.from ?? whole[0], state.to ?? whole[1]], whole);
      clearTimeout(loading);
      await load();
    },
    draw,
    leave() { abort?.abort(); clearTimeout(loading); },
  };
}
