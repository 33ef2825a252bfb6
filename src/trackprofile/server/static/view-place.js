// One place through time: its level on each day with a forecast, and the shape around it pass by pass.

import { ask } from "./api.js";
import { choice, el, fill, table, warnings } from "./dom.js";
import { drawAround, drawTime } from "./time.js";
import { dayNumber, half, km, number, signed } from "./words.js";

export function mount(root, app) {
  const time = el("canvas", { class: "tall", role: "img", "aria-label": "Level of the place over time, with its trend and forecast" });
  const around = el("canvas", { class: "strip", role: "img", "aria-label": "Level around the place, pass by pass" });
  const said = el("div", { class: "first" }), tools = el("div", { class: "tools" }), rows = el("div", {}), name = el("h1", {});
  const ofAround = el("h2", { class: "strip-name" }), ofTime = el("h2", { class: "strip-name" });
  let found = null;
  fill(root, name, tools, said, ofTime, time, ofAround, around, rows);

  function controls(state, at) {
    const [start, end] = app.whole();
    const field = el("input", { type: "text", inputmode: "decimal", size: 9, value: (at / 1000).toFixed(3), "aria-label": "kilometre of the place" });
    const move = (by, sign) => el("button", { type: "button", "aria-label": `${Math.abs(by)} m ${by < 0 ? "back" : "on"}`, onclick: () => app.go({ at: at + by }) }, sign);
    const { days } = app;
    fill(tools,
      el("form", { class: "jump", onsubmit: (event) => {
        event.preventDefault();
        const place = 1000 * Number(field.value.replace(",", "."));
        if (!(place >= start && place <= end)) return app.say(`Type a kilometre from ${number(start / 1000, 3)} to ${number(end / 1000, 3)}.`);
        app.go({ at: place });
      } }, el("label", {}, "km ", field), el("button", { type: "submit" }, "go")),
      move(-1, "−1 m"), move(1, "+1 m"),
      choice("Band", app.bands.map((one) => [one.name, `${one.name}, ${one.shortest_m}–${one.longest_m} m`]), state.band, (band) => app.go({ band })),
      choice("Passes since", [["", "the first"], ...days.slice(1, -1).map((one) => [one, one])], state.since || "", (since) => app.go({ since: since || undefined })),
      el("a", { href: app.href({ view: "line", at, from: Math.max(start, at - 100), to: Math.min(end, at + 100) }) }, "on the line"));
  }

  function sentences() {
    const { trend } = found, list = [];
    if (trend) {
      const month = 30 * trend.per_day_mm, wide = 1.96 * 30 * trend.per_day_deviation_mm, sure = Math.abs(month) > wide;
      const verb = found.level_mm[found.level_mm.length - 1] * month > 0 ? "grows" : "shrinks";
      list.push(sure ? `The height ${verb} by ${number(Math.abs(month))} ± ${number(wide)} mm in 30 days.` : `No change that the passes' uncertainty does not explain: ${signed(month)} ± ${number(wide)} mm in 30 days.`);
      if (!trend.straight) list.push("The passes do not lie on a line: if the track was worked on, choose the passes since then.");
      for (const one of found.beyond.slice(-1)) list.push(`It is beyond the limit of ${one.action} (${one.height_mm} mm).`);
      for (const one of found.reached) if (one.median) list.push(`If this goes on, ${one.action} (${one.height_mm} mm) on ${one.median}; with 95 % ${one.earliest} to ${one.latest || "later than in ten years"}.`);
    } else list.push("All passes are of one day, or there is one only: no rate can be told.");
    if (found.omitted) list.push(`${found.passes.length + found.left_out.length} of ${found.passes.length + found.left_out.length + found.omitted} passes are looked at, spread evenly over the time.`);
    fill(said, el("ul", {}, list.map((one) => el("li", {}, one))));
  }

  function list() {
    const heads = [{ name: "Date" }, { name: "Pass", minor: true }, { name: "Level, mm", number: true }, { name: "See" }];
    const told = found.passes.map((one, i) => ({ cells: [one.day, one.run || one.vehicle, { number: number(found.level_mm[i]) + half(found.deviation_mm[i]) }, see(one)] }));
    fill(rows, table(heads, told.reverse(), { label: "Passes that tell this place", id: "passes" }),
      found.left_out.length > 0 && [el("h2", {}, "Passes that do not"), el("ul", {}, found.left_out.map((one) => el("li", {}, `${one.day}${one.run ? ` ${one.run}` : ""}: ${one.reason}`)))], warnings(found.notes));
  }

  const see = (one) => el("a", { href: app.href({ view: "line", day: one.day, entry: one.entry, at: found.at_m, from: found.at_m - 100, to: found.at_m + 100 }) }, "on the line");

  function draw() {
    if (!found) return;
    drawTime(time, found);
    drawAround(around, found);
  }

  /** Where to look if nobody said where: the gravest place of what was looked at last. */
  async function gravest({ from, to }) {
    const found = await ask("defects", { ...app.where(), from, to, count: 1 });
    return found.defects[0]?.peak_m;
  }

  return {
    async update(state) {
      const [start, end] = app.whole(), at = Math.max(start, Math.min(end, state.at ?? (await gravest(state)) ?? (start + end) / 2));
      app.busy(true);
      if (state.at !== at) app.note({ at });
      fill(name, `Development at ${km(at)}`);
      controls(state, at);
      found = null;
      fill(said); fill(rows); fill(ofTime); fill(ofAround);
      found = await ask("place", { line: state.line, direction: state.direction, band: state.band, at, since: state.since });
      fill(ofTime, `${found.band}`, el("span", {}, "level over time in mm, each pass with its 95 % interval; trend and forecast with theirs"));
      const told = found.passes, last = told[told.length - 1].day;
      fill(ofAround, "Around the place", el("span", {}, `level in mm, ${told[0].day === last ? last : `${told[0].day} to ${last}, the later the darker`}`));
      const days = found.passes.map((one) => dayNumber(one.day));
      time.dataset.days = String(days[days.length - 1] - days[0]);
      sentences();
      list();
      draw();
      app.busy(false);
    },
    draw,
  };
}
