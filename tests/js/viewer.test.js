import assert from "node:assert/strict";
import { test } from "node:test";

import { addressOf, changedState, parsedState } from "../../src/trackprofile/server/static/state.js";
import { covers, tileOf } from "../../src/trackprofile/server/static/tiles.js";
import { shadeNumber } from "../../src/trackprofile/server/static/coverage.js";
import { parsedKilometre } from "../../src/trackprofile/server/static/dom.js";
import { dateTick, levelRangeOf, timeRange } from "../../src/trackprofile/server/static/location-charts.js";
import { sentences } from "../../src/trackprofile/server/static/view-location.js";
import { calendarText } from "../../src/trackprofile/server/static/view-quality.js";

test("an address and its state are inverse", () => {
  const state = { view: "compare", line: "Main <b> & ?", direction: "up", day: "2026-04-05", from: 12.5, to: 1e4, at: 20, compared_day: "2026-01-05" };
  assert.deepEqual(parsedState(addressOf(state).slice(1)), state);
});

test("invalid values of an address are omitted", () => {
  assert.deepEqual(parsedState("?view=<script>&from=nan&at=1e999&to=&unknown=1"), { view: "line" });
  assert.deepEqual(parsedState(`?line=${"x".repeat(201)}`), { view: "line" });
});

test("a key is removed by undefined", () => assert.deepEqual(changedState({ view: "line", at: 1 }, { at: undefined, band: "D2" }), { view: "line", band: "D2" }));

test("a tile contains its view and is shared by neighbouring views", () => {
  const whole = [0, 100_000];
  for (const view of [[0, 900], [20_000, 21_000], [99_000, 100_000], [512, 1024]]) {
    const tile = tileOf(view, whole, 2000);
    assert.ok(tile.from <= view[0] && tile.to >= view[1] && tile.bins <= 8000);
    assert.ok(tile.to - tile.from <= 3 * 2 ** Math.ceil(Math.log2(view[1] - view[0])));
    assert.ok(covers({ from_m: tile.from, to_m: tile.to }, view));
  }
  assert.deepEqual(tileOf([20_000, 21_000], whole, 2000), tileOf([20_030, 21_030], whole, 2000));
  assert.deepEqual(tileOf([0, 90_000], whole, 2000), { from: 0, to: 100_000, bins: 0 });
});

test("a close view requests every stored point", () => {
  const { from, to, bins } = tileOf([5000, 5300], [0, 100_000], 500);
  assert.equal(bins, (to - from) / 0.25 + 2);
});

test("shades go from the lowest standard deviation to four times of it", () => {
  assert.deepEqual([0.5, 1, 2, 4, 100].map((deviation) => shadeNumber(deviation, 1)), [0, 0, 3, 6, 6]);
});

test("kilometres are parsed as people type them", () => {
  for (const text of ["12.345", " 12,345 ", "km 12.345", "KM12.345"]) assert.equal(parsedKilometre(text), 12345);
  for (const text of ["", "x", "1.2.3"]) assert.ok(Number.isNaN(parsedKilometre(text)));
});

test("date ticks show year, month or day", () => {
  const time = Date.UTC(2026, 4, 3) / 1000, day = 86400;
  assert.deepEqual([day, 30 * day, 365 * day].map((step) => dateTick(time, step)), ["2026-05-03", "2026-05", "2026"]);
});

const DEVELOPMENT = {
  passes: [{ day: "2026-01-05" }, { day: "2026-04-05" }], excluded: [], omitted_passes: 0, level_mm: [-6, -9], standard_deviation_mm: [0.2, 0.2],
  forecast: [{ day: "2026-01-05", level_mm: -6, standard_deviation_mm: 0.1 }, { day: "2026-07-05", level_mm: -12, standard_deviation_mm: 0.5 }],
  limits: [{ action: "alert", height_mm: 8 }, { action: "intervention", height_mm: 10 }],
  trend: { rate_mm_per_day: -1 / 30, rate_standard_deviation_mm_per_day: 0.001, is_linear: true }, exceeded_limits: [{ action: "alert", height_mm: 8 }],
  limit_crossings: [{ action: "intervention", height_mm: 10, earliest: "2026-04-28", median: "2026-05-05", latest: null }],
};

test("the ranges of a development contain passes, forecast and the next limit", () => {
  const [start, end] = timeRange(DEVELOPMENT), [lowest, highest] = levelRangeOf(DEVELOPMENT);
  assert.ok(start < Date.UTC(2026, 0, 5) / 1000 && end > Date.UTC(2026, 6, 5) / 1000);
  assert.ok(lowest < -12 && highest === 0);
});

test("a development is described in sentences", () => {
  assert.deepEqual(sentences(DEVELOPMENT), [
    "The height increases by 1.00 ± 0.06 mm in 30 days.", "The limit of alert (8 mm) is exceeded.",
    "If the trend continues, the limit of intervention (10 mm) is reached on 2026-05-05; 95 % interval 2026-04-28 to later than in ten years.",
  ]);
  assert.match(sentences({ ...DEVELOPMENT, trend: { ...DEVELOPMENT.trend, rate_standard_deviation_mm_per_day: 1 } })[0], /^No significant change: −1\.00 ± 58\.80 mm/);
  assert.match(sentences({ ...DEVELOPMENT, trend: null, omitted_passes: 3 })[1], /^2 of 5 passes are used/);
});

test("the calendar names the longest interval without a pass", () => {
  assert.equal(calendarText(["2026-01-05", "2026-01-06", "2026-02-04"]), "3 days with passes, 2026-01-05 to 2026-02-04; the longest interval without one: 2026-01-06 to 2026-02-04 (29 days).");
  assert.equal(calendarText(["2026-01-05"]), "1 day with passes, 2026-01-05 to 2026-01-05.");
});
