// The stretch of line that is shown, [start, end] in metres: limited, zoomed, moved by keys.

export const MIN_LENGTH_M = 10;

/** The stretch within `whole`, at least `MIN_LENGTH_M` long. */
export function clamped([start, end], whole) {
  const length = Math.max(Math.min(MIN_LENGTH_M, whole[1] - whole[0]), Math.min(end - start, whole[1] - whole[0]));
  const first = Math.max(whole[0], Math.min((start + end - length) / 2, whole[1] - length));
  return [first, first + length];
}

/** The stretch scaled about a distance. */
export function zoomed(view, factor, centre, whole) {
  return clamped([centre - (centre - view[0]) * factor, centre + (view[1] - centre) * factor], whole);
}

/** The stretch shifted by a distance. */
export const shifted = (view, by, whole) => clamped([view[0] + by, view[1] + by], whole);

/** The stretch after a key is pressed; null for a key without effect. */
export function afterKey(key, view, whole) {
  const length = view[1] - view[0], middle = (view[0] + view[1]) / 2;
  switch (key) {
    case "ArrowLeft": return shifted(view, -length / 4, whole);
    case "ArrowRight": return shifted(view, length / 4, whole);
    case "PageUp": return shifted(view, -length, whole);
    case "PageDown": return shifted(view, length, whole);
    case "+": case "=": return zoomed(view, 0.5, middle, whole);
    case "-": return zoomed(view, 2, middle, whole);
    case "Home": return whole.slice();
    default: return null;
  }
}

/** Buttons that do what keys do: key, accessible name, text. */
export const BUTTONS = [
  ["ArrowLeft", "move left", "←"], ["ArrowRight", "move right", "→"], ["+", "zoom in", "+"], ["-", "zoom out", "−"], ["Home", "whole line", "all"],
];
