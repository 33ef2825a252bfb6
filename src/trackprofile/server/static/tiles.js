// Which stretches are asked for: of sizes that double, so that neighbouring views share what was fetched.

export const FINEST = 0.25; // m between stored points

/** m below which every stored point is asked for. */
const CLOSE = 500;

/** {from, to, width} that holds a view with some to spare; width 0 where the whole line does as well. */
export function tileOf(view, whole, pixels) {
  const length = 2 ** Math.ceil(Math.log2(view[1] - view[0])), all = whole[1] - whole[0];
  if (length >= all) return { from: whole[0], to: whole[1], width: 0 };
  const from = Math.max(whole[0], Math.floor(view[0] / (length / 2) - 0.25) * (length / 2));
  const to = Math.min(whole[1], Math.ceil(view[1] / (length / 2) + 0.25) * (length / 2));
  const bins = view[1] - view[0] <= CLOSE ? (to - from) / FINEST : ((to - from) / (view[1] - view[0])) * pixels;
  return { from, to, width: Math.min(8000, Math.ceil(bins) + 2) };
}

export const covers = (strip, view) => strip.from_m <= view[0] + 1e-6 && strip.to_m >= view[1] - 1e-6;
