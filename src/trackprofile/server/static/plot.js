// The few marks that every chart is made of, on a canvas that knows the screen's pixels.

export const INK = "#333", FAINT = "#e6e8ea", BLUE = "#0072B2", SKY = "rgba(86,180,233,0.42)", GREY = "#8C8C8C";
const FONT = "12px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";

/** The pen of a canvas, cleared and in CSS pixels. */
export function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  pen.lineWidth = 1;
  return { pen, width, height };
}

/** Margins around what is drawn. */
export function boxOf(width, height, margins = {}) {
  const { left = 58, right = 12, top = 8, bottom = 20 } = margins;
  return { left, right: width - right, top, bottom: height - bottom, width: Math.max(1, width - left - right), height: Math.max(1, height - top - bottom) };
}

/** From values to pixels. */
export const scale = (range, from, to) => (value) => from + ((value - range[0]) / (range[1] - range[0])) * (to - from);

export function niceStep(whole, count) {
  const raw = whole / Math.max(1, count), power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((one) => one * power >= raw * (1 - 1e-9));
}

export function ticks(range, count) {
  const step = niceStep(range[1] - range[0], count), found = [];
  for (let i = Math.ceil(range[0] / step - 1e-9); i * step <= range[1] * (1 + 1e-12) + step * 1e-9; i++) found.push(i * step);
  return { step, at: found };
}

/** Lines up and their names below; the first is `named` in full, names that would overlap are left out. */
export function axisBelow(pen, box, x, marks, name, options = {}) {
  let after = -Infinity;
  for (const at of marks) {
    const place = Math.round(x(at)) + 0.5;
    pen.strokeStyle = FAINT;
    line(pen, place, box.top, place, box.bottom);
    if (options.unnamed) continue;
    const text = name(at), width = pen.measureText(text).width;
    const middle = Math.max(options.least ?? width / 2, Math.min(place, (options.most ?? box.right + 10) - width / 2));
    if (middle - width / 2 < after + 10) continue;
    pen.fillStyle = INK;
    pen.textAlign = "center";
    pen.fillText(text, middle, box.bottom + 15);
    after = middle + width / 2;
  }
}

/** Lines across and their values at the left. */
export function axisLeft(pen, box, y, range, options = {}) {
  const { step, at } = ticks(range, options.count ?? Math.max(4, box.height / 34));
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  pen.textAlign = "right";
  for (const value of at) {
    const place = Math.round(y(value)) + 0.5;
    if (place < box.top - 1 || place > box.bottom + 1) continue;
    pen.strokeStyle = value === 0 ? "#9aa4ad" : FAINT;
    line(pen, box.left, place, box.right, place);
    pen.fillStyle = INK;
    const text = Math.abs(value).toFixed(digits);
    pen.fillText((value < -1e-12 ? "−" : "") + text, box.left - 6, Math.min(Math.max(place + 4, box.top + 8), box.bottom + 2));
  }
}

export function line(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

/** Draws only within the box. */
export function within(pen, box, draw) {
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top, box.width, box.height);
  pen.clip();
  draw();
  pen.restore();
}

/** Runs of neighbours that are known: [first, last]. */
export function pieces(values, from = 0, to = values.length - 1) {
  const found = [];
  for (let i = Math.max(0, from); i <= Math.min(to, values.length - 1); i++) {
    if (values[i] === null) continue;
    const first = i;
    while (i < to && values[i + 1] !== null && values[i + 1] !== undefined) i++;
    found.push([first, i]);
  }
  return found;
}

/** The area between two edges given by index. */
export function area(pen, first, last, x, low, high, colour) {
  pen.fillStyle = colour;
  pen.beginPath();
  for (let i = first; i <= last; i++) pen.lineTo(x(i), high(i));
  for (let i = last; i >= first; i--) pen.lineTo(x(i), low(i));
  pen.closePath();
  pen.fill();
}

/** A label that stays readable over lines; y is its middle. */
export function label(pen, text, x, y, colour = INK, align = "left") {
  const width = pen.measureText(text).width;
  pen.textAlign = align;
  pen.fillStyle = "rgba(255,255,255,0.85)";
  pen.fillRect(align === "right" ? x - width - 2 : x - 2, y - 7, width + 4, 14);
  pen.fillStyle = colour;
  pen.fillText(text, x, y + 4);
}

/** How many names of places fit below a box. */
export const fitting = (box) => Math.max(2.5, box.width / 88);

/** The least range about zero that holds a size, in round steps: it stays while one moves a little. */
export function roundRange(size) {
  const power = 10 ** Math.floor(Math.log10(size)), most = power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((one) => one * power >= size);
  return [-most, most];
}
