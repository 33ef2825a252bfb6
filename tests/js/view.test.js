import assert from "node:assert/strict";
import { test } from "node:test";

import { BUTTONS, MIN_LENGTH_M, afterKey, clamped, shifted, zoomed } from "../../src/trackprofile/reporting/web/view.js";

const WHOLE = [1000, 5000];

test("a stretch stays within the line and is never shorter than the minimum", () => {
  assert.deepEqual(clamped([0, 1000], WHOLE), [1000, 2000]);
  assert.deepEqual(clamped([4800, 5400], WHOLE), [4400, 5000]);
  assert.deepEqual(clamped([0, 9000], WHOLE), WHOLE);
  assert.deepEqual(clamped([2000, 2000], WHOLE), [2000 - MIN_LENGTH_M / 2, 2000 + MIN_LENGTH_M / 2]);
  assert.deepEqual(clamped([0, 100], [0, 4]), [0, 4]);
});

test("zoom keeps the distance under the pointer", () => {
  const [start, end] = zoomed([2000, 3000], 0.5, 2250, WHOLE);
  assert.equal(end - start, 500);
  assert.equal((2250 - start) / (end - start), 0.25);
});

test("keys move and zoom, others do nothing", () => {
  const view = [2000, 3000];
  assert.deepEqual(afterKey("ArrowRight", view, WHOLE), [2250, 3250]);
  assert.deepEqual(afterKey("ArrowLeft", view, WHOLE), [1750, 2750]);
  assert.deepEqual(afterKey("PageDown", view, WHOLE), [3000, 4000]);
  assert.deepEqual(afterKey("PageUp", view, WHOLE), [1000, 2000]);
  assert.deepEqual(afterKey("+", view, WHOLE), [2250, 2750]);
  assert.deepEqual(afterKey("-", view, WHOLE), [1500, 3500]);
  assert.deepEqual(afterKey("Home", view, WHOLE), WHOLE);
  for (const key of ["a", "Tab", "Enter"]) assert.equal(afterKey(key, view, WHOLE), null);
  for (const [key] of BUTTONS) assert.notEqual(afterKey(key, view, WHOLE), null);
});

test("a shift stops at the end of the line", () => assert.deepEqual(shifted([4000, 5000], 500, WHOLE), [4000, 5000]));
