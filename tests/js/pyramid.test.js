import assert from "node:assert/strict";
import { test } from "node:test";

import { UNKNOWN, copyFor, envelopeOf, pyramid, unpacked } from "../../src/trackprofile/reporting/web/pyramid.js";

const COUNT = 20_000;
const VALUES = Int16Array.from({ length: COUNT }, (_, i) => (i >= 9000 && i < 9040 ? UNKNOWN : Math.round(1000 * Math.sin(i / 7) + 300 * Math.sin(i / 1.3))));
const LEVEL = { copies: pyramid(VALUES), deviation: Int16Array.from({ length: COUNT / 4 }, () => 50), deviation_stride: 4, first_m: 500, spacing_m: 0.25, unit_mm: 0.01 };

test("base 64 is unpacked as little-endian 16-bit integers", () => {
  const bytes = Buffer.from(new Int16Array([100, -1, UNKNOWN]).buffer);
  assert.deepEqual([...unpacked(bytes.toString("base64"))], [100, -1, UNKNOWN]);
  assert.equal(unpacked(""), null);
});

test("every copy has the minimum and maximum of its points", () => {
  for (const { low, high, size } of LEVEL.copies) {
    for (const i of [0, 1, Math.floor(9010 / size), low.length - 1]) {
      const known = [...VALUES.slice(i * size, (i + 1) * size)].filter((value) => value !== UNKNOWN);
      assert.equal(low[i], known.length ? Math.min(...known) : UNKNOWN);
      assert.equal(high[i], known.length ? Math.max(...known) : UNKNOWN);
    }
  }
  assert.ok(LEVEL.copies.at(-1).low.length <= 1024);
});

test("the copy is the coarsest with a point per pixel", () => {
  assert.deepEqual([0.5, 1, 3.9, 4, 17].map((points) => copyFor(LEVEL.copies, points).size), [1, 1, 1, 4, 16]);
});

test("an envelope covers the stretch, with at most a few points per pixel", () => {
  const view = [600, 5000], pixels = 1000, envelope = envelopeOf(LEVEL, view, pixels);
  const end = envelope.from_m + envelope.low_mm.length * envelope.bin_m;
  assert.ok(envelope.from_m <= view[0] && end >= view[1]);
  assert.ok(envelope.low_mm.length <= 4 * pixels + 3);
  const i = Math.floor((3000 - envelope.from_m) / envelope.bin_m), first = Math.round((envelope.from_m + i * envelope.bin_m - 500) / 0.25);
  const points = VALUES.slice(first, first + Math.round(envelope.bin_m / 0.25));
  assert.ok(Math.abs(envelope.low_mm[i] - Math.min(...points) / 100) < 1e-9);
  assert.ok(Math.abs(envelope.standard_deviation_mm[i] - 0.5) < 1e-9);
});

test("an unknown level is null, without a standard deviation", () => {
  const envelope = envelopeOf(LEVEL, [2752, 2758], 1000), i = Math.floor((2755 - envelope.from_m) / envelope.bin_m);
  assert.equal(envelope.low_mm[i], null);
  assert.equal(envelope.standard_deviation_mm[i], null);
});
