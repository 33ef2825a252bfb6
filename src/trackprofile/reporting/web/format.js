// How chainages, lengths, dates and numbers are written.

export const MINUS = "−";

/** Half width of a 95 % interval in standard deviations. */
export const HALF_WIDTH_95 = 1.96;

/** A number with a true minus sign; an en dash where there is none. */
export function number(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

export const signed = (value, digits = 2) => (value > 0 ? "+" : "") + number(value, digits);

/** " ± 0.12": half of the 95 % interval, with two significant digits or so; empty without a standard deviation. */
export function plusMinus(standardDeviation) {
  if (!standardDeviation) return "";
  const half = HALF_WIDTH_95 * standardDeviation;
  return ` ± ${half.toFixed(half >= 1 ? 1 : half >= 0.1 ? 2 : 3)}`;
}

/** The level in a bin in mm: its range where minimum and maximum differ as written. */
export function levelText({ low, high, deviation }) {
  const [from, to] = [number(low), number(high)];
  return `${from === to ? from : `${from} to ${to}`}${plusMinus(deviation)} mm`;
}

/** "km 12.345" */
export const km = (metres, digits = 3) => `km ${number(metres / 1000, digits)}`;

/** Decimals of a kilometre that distinguish ticks `step` metres apart. */
export const kmDigits = (step) => Math.max(0, Math.min(4, 3 - Math.floor(Math.log10(step) + 1e-9)));

/** A length along the line: in metres below 1 km. */
export function lengthText(metres) {
  if (metres < 1000) return `${number(metres, metres < 10 ? 2 : 0)} m`;
  const kilometres = metres / 1000;
  return `${number(kilometres, kilometres < 10 ? 2 : kilometres < 100 ? 1 : 0)} km`;
}

/** A probability in percent; 0 and 100 only where it is exactly that. */
export function percent(probability) {
  if (probability === null || probability === undefined) return "–";
  if (probability >= 0.995 && probability < 1) return ">99 %";
  if (probability > 0 && probability < 0.005) return "<1 %";
  return `${(100 * probability).toFixed(0)} %`;
}

export const share = (part) => `${(100 * part).toFixed(part > 0.9995 || part === 0 ? 0 : 1)} %`;

/** "1 pass", "2 passes", "12 000 passes" */
export const counted = (count, singular, plural = `${singular}s`) => `${count.toLocaleString("en").replaceAll(",", " ")} ${count === 1 ? singular : plural}`;

const DAY_MS = 86400000;
/** Days since 1970-01-01 of a date "YYYY-MM-DD", and back. */
export const dayNumber = (date) => Math.round(Date.parse(`${date}T00:00:00Z`) / DAY_MS);
export const dateText = (days) => new Date(days * DAY_MS).toISOString().slice(0, 10);
