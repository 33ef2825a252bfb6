// How places, lengths, days and actions are written.

export const MINUS = "−";
export const WIDE = 1.96; // standard deviations of a 95 % interval

/** Actions from the gravest: what they are called, the colours of their marks and words. */
export const ACTIONS = [
  { key: "immediate action", short: "immediate", colour: "#A3001B", ink: "#A3001B", grade: 3 },
  { key: "intervention", short: "intervention", colour: "#D55E00", ink: "#B34E00", grade: 2 },
  { key: "alert", short: "alert", colour: "#E69F00", ink: "#855C00", grade: 1 },
  { key: "", short: "possible", colour: "#7A8794", ink: "#55606a", grade: 0 },
];

export const actionOf = (key) => ACTIONS.find((one) => one.key === key) || ACTIONS[3];
export const callsFor = (key) => key || "possible";

/** A number with a true minus sign. */
export function number(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** From the least to the greatest of a bin, where they differ in what is shown. */
export function between({ low, high, deviation }) {
  const [from, to] = [number(low), number(high)];
  return `${from === to ? from : `${from} to ${to}`}${half(deviation)} mm`;
}

export const signed = (value, digits = 2) => (value > 0 ? "+" : "") + number(value, digits);

/** A half width of 95 %, to a digit that tells something. */
export function half(deviation) {
  if (!deviation) return "";
  const wide = WIDE * deviation;
  return ` ± ${wide.toFixed(wide >= 1 ? 1 : wide >= 0.1 ? 2 : 3)}`;
}

/** "km 12.345" */
export const km = (metres, digits = 3) => `km ${number(metres / 1000, digits)}`;

/** A length along the line: metres below a kilometre. */
export function span(metres) {
  if (metres < 1000) return `${number(metres, metres < 10 ? 2 : 0)} m`;
  const kilometres = metres / 1000;
  return `${number(kilometres, kilometres < 10 ? 2 : kilometres < 100 ? 1 : 0)} km`;
}

/** Digits after a kilometre's point that tell ticks of some metres apart. */
export const kmDigits = (step) => Math.max(0, Math.min(4, 3 - Math.floor(Math.log10(step) + 1e-9)));

/** Neither 0 nor 100 % unless it is. */
export function percent(probability) {
  if (probability === null || probability === undefined) return "–";
  if (probability >= 0.995 && probability < 1) return ">99 %";
  if (probability > 0 && probability < 0.005) return "<1 %";
  return `${(100 * probability).toFixed(0)} %`;
}

export const share = (part) => `${(100 * part).toFixed(part > 0.9995 || part === 0 ? 0 : 1)} %`;
export const counted = (count, one, more = `${one}s`) => `${count.toLocaleString("en").replaceAll(",", " ")} ${count === 1 ? one : more}`;

const DAY = 86400000;
export const dayNumber = (day) => Math.round(Date.parse(`${day}T00:00:00Z`) / DAY);
export const dayOf = (count) => new Date(count * DAY).toISOString().slice(0, 10);
