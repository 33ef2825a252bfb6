import assert from "node:assert/strict";
import { test } from "node:test";

import { binCentres, largestLevel, levelAt, levelRange, roundRange, unknownStretches, visibleBins } from "../../src/trackprofile/reporting/web/envelope.js";

const ENVELOPE = { from_m: 100, bin_m: 10, low_mm: [-1, null, -2, -3], high_mm: [1, null, 2, 3], standard_deviation_mm: [0.5, null, 0.5, null] };

test("the visible bins include one more on each side", () => {
  assert.deepEqual(visibleBins(ENVELOPE, [120, 125]), [1, 3]);
  assert.deepEqual(visibleBins(ENVELOPE, [0, 1000]), [0, 3]);
});

test("the centre of a bin is the middle of its points", () => {
  assert.deepEqual(binCentres(ENVELOPE).slice(0, 2), [104.875, 114.875]);
  assert.deepEqual(binCentres({ ...ENVELOPE, bin_m: 0.25 }).slice(0, 2), [100, 100.25]);
});

test("the largest level includes the 95 % interval and only what is visible", () => {
  assert.equal(largestLevel(ENVELOPE, [0, 1000]), 3);
  assert.equal(largestLevel({ ...ENVELOPE, standard_deviation_mm: [5, null, 0, 0] }, [0, 1000]), 1 + 1.96 * 5);
  assert.equal(largestLevel(ENVELOPE, [100, 101]), 2 + 1.96 * 0.5);
});

test("a range is symmetric, round, and contains the lowest limit", () => {
  assert.deepEqual([0.9, 1.2, 7, 10.1, 23].map((value) => roundRange(value)[1]), [1, 1.5, 8, 15, 30]);
  assert.deepEqual(levelRange([ENVELOPE, null], [0, 1000], [{ height_mm: 8 }, { height_mm: 23 }]), [-10, 10]);
  assert.deepEqual(levelRange([null], [0, 1]), [-0.06, 0.06]);
});

test("the level at a distance is that of its bin, null where unknown", () => {
  assert.deepEqual(levelAt(ENVELOPE, 125), { low: -2, high: 2, deviation: 0.5 });
  for (const distance of [99, 115, 140]) assert.equal(levelAt(ENVELOPE, distance), null);
  assert.equal(levelAt(null, 125), null);
});

test("unknown stretches are consecutive bins without a level", () => {
  assert.deepEqual(unknownStretches(ENVELOPE, [0, 3]), [[110, 120]]);
  assert.deepEqual(unknownStretches({ ...ENVELOPE, low_mm: [null, null, 1, null] }, [0, 3]), [[100, 120], [130, 140]]);
});
