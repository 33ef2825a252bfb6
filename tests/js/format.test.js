import assert from "node:assert/strict";
import { test } from "node:test";

import { counted, dateText, dayNumber, km, kmDigits, lengthText, levelText, number, percent, plusMinus, share, signed } from "../../src/trackprofile/reporting/web/format.js";

test("a number has a true minus sign, never minus zero, and a dash where there is none", () => {
  assert.equal(number(-1.234), "−1.23");
  assert.equal(number(-0.001), "0.00");
  assert.equal(number(2, 0), "2");
  for (const none of [null, undefined, NaN, Infinity]) assert.equal(number(none), "–");
  assert.equal(signed(0.5), "+0.50");
  assert.equal(signed(-0.5), "−0.50");
});

test("half of the 95 % interval is written with digits that suit its size", () => {
  assert.equal(plusMinus(1), " ± 2.0");
  assert.equal(plusMinus(0.1), " ± 0.20");
  assert.equal(plusMinus(0.01), " ± 0.020");
  assert.equal(plusMinus(0), "");
  assert.equal(plusMinus(undefined), "");
});

test("the level of a bin is a range only where its ends differ as written", () => {
  assert.equal(levelText({ low: -1.001, high: -1.002, deviation: 0.1 }), "−1.00 ± 0.20 mm");
  assert.equal(levelText({ low: -1, high: 2, deviation: null }), "−1.00 to 2.00 mm");
});

test("kilometres have the decimals that distinguish ticks", () => {
  assert.equal(km(12345), "km 12.345");
  assert.equal(km(12345, 1), "km 12.3");
  assert.equal(km(-500), "km −0.500");
  assert.deepEqual([0.1, 1, 2, 10, 100, 1000, 5000].map(kmDigits), [4, 3, 3, 2, 1, 0, 0]);
});

test("lengths below a kilometre are in metres", () => {
  assert.deepEqual([2.5, 600, 1234, 45678, 250000].map(lengthText), ["2.50 m", "600 m", "1.23 km", "45.7 km", "250 km"]);
});

test("a probability is 0 or 100 % only where it is exactly that", () => {
  assert.deepEqual([0, 0.001, 0.36, 0.997, 1, null].map(percent), ["0 %", "<1 %", "36 %", ">99 %", "100 %", "–"]);
  assert.deepEqual([0, 0.013, 1].map(share), ["0 %", "1.3 %", "100 %"]);
});

test("counts have the right plural and spaces between thousands", () => {
  assert.deepEqual([0, 1, 2, 12000].map((count) => counted(count, "pass", "passes")), ["0 passes", "1 pass", "2 passes", "12 000 passes"]);
});

test("dates and day numbers are inverse", () => {
  for (const date of ["1970-01-01", "2024-02-29", "2026-12-31"]) assert.equal(dateText(dayNumber(date)), date);
  assert.equal(dayNumber("2026-03-01") - dayNumber("2026-02-28"), 1);
});
