// Round positions on axes.

/** Steps 1, 2, 5 times powers of ten, for the axes of charts. */
export const ROUND_STEPS = Array.from({ length: 12 }, (_, i) => i - 4).flatMap((power) => [1, 2, 5].map((one) => Number(`${one}e${power}`)));

/** The smallest round step that divides a length into at most `count` parts. */
export function roundStep(length, count) {
  const raw = length / Math.max(1, count), power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((one) => one * power >= raw * (1 - 1e-9));
}

/** Multiples of a round step within a range, about `count` of them: {step, at}. */
export function roundTicks(range, count) {
  const step = roundStep(range[1] - range[0], count), at = [];
  for (let i = Math.ceil(range[0] / step - 1e-9); i * step <= range[1] * (1 + 1e-12) + step * 1e-9; i++) at.push(i * step);
  return { step, at };
}

/** Decimals that distinguish multiples of a step. */
export const decimalsFor = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

/** A linear scale from values to pixels. */
export const linearScale = (range, from, to) => (value) => from + ((value - range[0]) / (range[1] - range[0])) * (to - from);
