// What drawings on a canvas share: colours of the palette, marks, and the frame of drawings that are not charts.

export const FONT = "12px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";

const colours = new Map();

/** A colour of the palette (a CSS custom property), with an opacity. */
export function colour(name, opacity = 1) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return opacity === 1 ? colours.get(name) : colours.get(name) + Math.round(255 * opacity).toString(16).padStart(2, "0");
}

/** The mark of an action by grade: circle, triangle, diamond, square; distinguishable without colour. */
export function drawMark(pen, x, y, grade, fill, size = 4.5) {
  pen.fillStyle = fill;
  pen.beginPath();
  if (grade === 0) pen.arc(x, y, 0.6 * size, 0, 2 * Math.PI);
  else if (grade === 1) { pen.moveTo(x - size, y + size * 0.8); pen.lineTo(x, y - size); pen.lineTo(x + size, y + size * 0.8); }
  else if (grade === 2) { pen.moveTo(x - size, y); pen.lineTo(x, y - size); pen.lineTo(x + size, y); pen.lineTo(x, y + size); }
  else pen.rect(x - size * 0.9, y - size * 0.9, size * 1.8, size * 1.8);
  pen.fill();
}

export function drawLine(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

/** A canvas cleared and scaled to CSS pixels, with the box inside margins. */
export function preparedCanvas(canvas, margins) {
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
  return { pen, box: innerBox(width, height, margins) };
}

/** The box inside margins, in CSS pixels. */
export function innerBox(width, height, { left, right, top, bottom }) {
  return { left, right: width - right, top, bottom: height - bottom, width: Math.max(1, width - left - right), height: Math.max(1, height - top - bottom) };
}

/** A distance axis below a box: grid lines and labels; labels that would overlap are omitted. */
export function drawDistanceAxis(pen, box, x, marks, name, rightmost) {
  let end = -Infinity;
  for (const distance of marks) {
    const at = Math.round(x(distance)) + 0.5;
    pen.strokeStyle = colour("grid");
    drawLine(pen, at, box.top, at, box.bottom);
    const text = name(distance), width = pen.measureText(text).width;
    const middle = Math.max(width / 2, Math.min(at, rightmost - width / 2));
    if (middle - width / 2 < end + 10) continue;
    pen.fillStyle = colour("ink");
    pen.textAlign = "center";
    pen.fillText(text, middle, box.bottom + 15);
    end = middle + width / 2;
  }
}
