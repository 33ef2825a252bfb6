// Envelopes: the minimum and maximum of a level in bins of equal length, as charts draw them.
// {from_m, bin_m, offset_m, low_mm, high_mm, standard_deviation_mm}; null where the level is not known.

import { HALF_WIDTH_95 } from "./format.js";

/** Spacing of the stored points, m. */
export const POINT_SPACING_M = 0.25;

/** First and last bin of an envelope that a stretch touches, with one to spare. */
export function visibleBins(envelope, view) {
  const first = Math.floor((view[0] - envelope.from_m) / envelope.bin_m) - 1;
  const last = Math.ceil((view[1] - envelope.from_m) / envelope.bin_m) + 1;
  return [Math.max(0, first), Math.min(envelope.low_mm.length - 1, last)];
}

/** Distance of the middle of the points of each bin, m. */
export function binCentres(envelope) {
  const { from_m: from, bin_m: bin, spacing_m: spacing = POINT_SPACING_M } = envelope;
  return envelope.low_mm.map((_, i) => from + i * bin + Math.max(0, bin - spacing) / 2);
}

/** Largest absolute value of a level and its 95 % interval in a stretch, mm. */
export function largestLevel(envelope, view) {
  const [first, last] = visibleBins(envelope, view);
  let largest = 0;
  for (let i = first; i <= last; i++) {
    if (envelope.low_mm[i] === null) continue;
    const half = HALF_WIDTH_95 * (envelope.standard_deviation_mm[i] || 0);
    largest = Math.max(largest, Math.abs(envelope.low_mm[i] - half), Math.abs(envelope.high_mm[i] + half));
  }
  return largest;
}

/** The smallest range symmetric about zero, with round ends, that contains a value. */
export function roundRange(value) {
  const power = 10 ** Math.floor(Math.log10(value)), end = power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((one) => one * power >= value);
  return [-end, end];
}

/** The range that shows envelopes and the lowest limit. */
export function levelRange(envelopes, view, limits = []) {
  const sizes = envelopes.map((envelope) => (envelope ? largestLevel(envelope, view) : 0));
  return roundRange(1.04 * Math.max(...sizes, limits.length ? 1.12 * limits[0].height_mm : 0, 0.05));
}

/** The level at a distance: {low, high, deviation} in mm, or null. */
export function levelAt(envelope, distance) {
  if (!envelope) return null;
  const i = Math.floor((distance - envelope.from_m) / envelope.bin_m);
  if (i < 0 || i >= envelope.low_mm.length || envelope.low_mm[i] === null) return null;
  return { low: envelope.low_mm[i], high: envelope.high_mm[i], deviation: envelope.standard_deviation_mm[i] };
}

/** Stretches of an envelope without a known level, [start, end] in m, between two bins. */
export function unknownStretches(envelope, [first, last]) {
  const stretches = [];
  for (let i = first; i <= last; i++) {
    if (envelope.low_mm[i] !== null) continue;
    const begin = i;
    while (i < last && envelope.low_mm[i + 1] === null) i++;
    stretches.push([envelope.from_m + begin * envelope.bin_m, envelope.from_m + (i + 1) * envelope.bin_m]);
  }
  return stretches;
}
