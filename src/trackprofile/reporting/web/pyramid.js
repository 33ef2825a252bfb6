// A long level in coarser and coarser copies (minimum and maximum), so that a drawing costs as much over 50 km as over 50 m.

/** Count that stands for an unknown level. */
export const UNKNOWN = -32768;
const FACTOR = 4, SMALLEST = 1024;

/** 16-bit integers from base 64, the lower byte first; null from an empty text. */
export function unpacked(text) {
  if (!text) return null;
  return new Int16Array(Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);
}

/** Copies of a level, each with a quarter of the points: {low, high, size} with `size` points of the level per point. */
export function pyramid(values) {
  const copies = [{ low: values, high: values, size: 1 }];
  while (copies[copies.length - 1].low.length > SMALLEST) copies.push(coarser(copies[copies.length - 1]));
  return copies;
}

function coarser(finer) {
  const count = Math.ceil(finer.low.length / FACTOR), low = new Int16Array(count), high = new Int16Array(count);
  for (let i = 0; i < count; i++) {
    let minimum = 32767, maximum = UNKNOWN;
    for (let k = FACTOR * i; k < Math.min(FACTOR * (i + 1), finer.low.length); k++) {
      if (finer.low[k] === UNKNOWN) continue;
      minimum = Math.min(minimum, finer.low[k]);
      maximum = Math.max(maximum, finer.high[k]);
    }
    low[i] = maximum === UNKNOWN ? UNKNOWN : minimum;
    high[i] = maximum;
  }
  return { low, high, size: finer.size * FACTOR };
}

/** The coarsest copy that has a point per pixel, for so many points of the level per pixel. */
export const copyFor = (copies, pointsPerPixel) => copies.findLast((copy) => copy.size <= pointsPerPixel) || copies[0];

/**
 * The envelope of a stretch of a level.
 * `level` is {copies, deviation, deviation_stride, first_m, spacing_m, unit_mm}, with counts of `unit_mm`.
 */
export function envelopeOf(level, view, pixels) {
  const { copies, deviation, deviation_stride: stride, first_m: start, spacing_m: spacing, unit_mm: unit } = level;
  const copy = copyFor(copies, (view[1] - view[0]) / spacing / Math.max(1, pixels)), bin = copy.size * spacing;
  const first = Math.max(0, Math.floor((view[0] - start) / bin) - 1);
  const last = Math.min(copy.low.length - 1, Math.ceil((view[1] - start) / bin) + 1);
  const envelope = { from_m: start + first * bin, bin_m: bin, spacing_m: spacing, low_mm: [], high_mm: [], standard_deviation_mm: [] };
  for (let i = first; i <= last; i++) {
    const known = copy.low[i] !== UNKNOWN;
    envelope.low_mm.push(known ? copy.low[i] * unit : null);
    envelope.high_mm.push(known ? copy.high[i] * unit : null);
    const at = deviation && Math.min(deviation.length - 1, Math.floor(((i + 0.5) * copy.size) / stride));
    envelope.standard_deviation_mm.push(known && deviation ? deviation[at] * unit : null);
  }
  return envelope;
}
