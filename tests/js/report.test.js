import assert from "node:assert/strict";
import { test } from "node:test";

import { kilometreOf, stretchOf } from "../../src/trackprofile/reporting/web/report-address.js";
import { decimalsFor, linearScale, roundStep, roundTicks } from "../../src/trackprofile/reporting/web/ticks.js";

test("kilometres are interpolated between the points of the table, and held at its ends", () => {
  const table = { start_m: 100, chainage_step_m: 10, chainage_km: [40, 39.99, 39.98] };
  assert.ok(Math.abs(kilometreOf(table, 105) - 39.995) < 1e-9);
  assert.equal(kilometreOf(table, 0), 40);
  assert.ok(Math.abs(kilometreOf(table, 500) - 39.98) < 2e-5);
});

test("an address gives a stretch about its distance", () => {
  assert.deepEqual(stretchOf("#at=1650.0&span=200"), [1550, 1750]);
  assert.deepEqual(stretchOf("#at=-50"), [-150, 50]);
  for (const hash of ["", "#caveats", "#at="]) assert.equal(stretchOf(hash), null);
});

test("ticks are multiples of a round step", () => {
  assert.deepEqual(roundTicks([0.3, 2.1], 4), { step: 0.5, at: [0.5, 1, 1.5, 2] });
  assert.deepEqual([9, 10, 11, 60].map((length) => roundStep(length, 10)), [1, 1, 2, 10]);
  assert.deepEqual([0.05, 0.5, 1, 20].map(decimalsFor), [2, 1, 0, 0]);
  assert.equal(linearScale([0, 10], 100, 300)(5), 200);
});
