// Which stretches are requested: their lengths are powers of two, so that neighbouring views share what was fetched.

import { POINT_SPACING_M } from "./shared/envelope.js";

/** Length of a view up to which every stored point is requested, m. */
const FULL_DETAIL_M = 500;

/** Most bins that the server gives. */
const MAX_BINS = 8000;

/** {from, to, bins} that contains a view with some margin; bins 0 where the whole line does as well. */
export function tileOf(view, whole, pixels) {
  const length = 2 ** Math.ceil(Math.log2(view[1] - view[0]));
  if (length >= whole[1] - whole[0]) return { from: whole[0], to: whole[1], bins: 0 };
  const from = Math.max(whole[0], Math.floor(view[0] / (length / 2) - 0.25) * (length / 2));
  const to = Math.min(whole[1], Math.ceil(view[1] / (length / 2) + 0.25) * (length / 2));
  const bins = view[1] - view[0] <= FULL_DETAIL_M ? (to - from) / POINT_SPACING_M : ((to - from) / (view[1] - view[0])) * pixels;
  return { from, to, bins: Math.min(MAX_BINS, Math.ceil(bins) + 2) };
}

/** Whether an envelope reaches over a view. */
export const covers = (envelope, view) => envelope.from_m <= view[0] + 1e-6 && envelope.to_m >= view[1] - 1e-6;
