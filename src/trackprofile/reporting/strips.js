"use strict";
// Strip charts of a track: one canvas per band over one distance axis. Each level is kept as a pyramid of minima and
// maxima, so that a drawing costs as much over 50 km as over 50 m.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const GRADES = ["#E69F00", "#E69F00", "#D55E00", "#B00020"]; // possible, alert, intervention, immediate action
  const CLASSES = ["#009E73", "#56B4E9", "#F0E442", "#E69F00", "#D55E00", "#B00020"];
  const LEFT = 56, RIGHT = 8, TOP = 6, BOTTOM = 18, LEAST = 5;
  const whole = [data.start, data.end];
  let view = whole.slice(), waiting = false;

  const counts = (text) => {
    if (!text) return null;
    const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    return new Int16Array(bytes.buffer);
  };
  const pyramid = (values) => {
    const known = (value) => value !== -32768;
    const levels = [{ low: values, high: values, size: 1 }];
    while (levels[levels.length - 1].low.length > 1024) {
      const last = levels[levels.length - 1], count = Math.ceil(last.low.length / 4);
      const low = new Int16Array(count), high = new Int16Array(count);
      for (let i = 0; i < count; i++) {
        let least = 32767, most = -32768;
        for (let k = 4 * i; k < Math.min(4 * i + 4, last.low.length); k++) {
          if (!known(last.low[k])) continue;
          least = Math.min(least, last.low[k]);
          most = Math.max(most, last.high[k]);
        }
        low[i] = most === -32768 ? -32768 : least;
        high[i] = most;
      }
      levels.push({ low, high, size: last.size * 4 });
    }
    return levels;
  };
  const bands = data.bands.map((band) => {
    const level = counts(band.level), beside = counts(band.beside);
    let most = 1;
    for (const value of level) if (value !== -32768) most = Math.max(most, Math.abs(value));
    return {
      ...band, level: pyramid(level), beside: beside && pyramid(beside), deviation: counts(band.deviation),
      most: Math.max(most * data.step, ...band.limits.slice(0, 1).map((limit) => limit[1])) * 1.08,
      canvas: document.getElementById("chart-" + band.name),
    };
  });
  const sections = document.getElementById("chart-sections"), overview = document.getElementById("overview");

  const kilometre = (distance) => {
    const at = Math.max(0, Math.min((distance - data.start) / data.post_every, data.kilometres.length - 1.001));
    const i = Math.floor(at), share = at - i;
    return data.kilometres[i] + share * (data.kilometres[Math.min(i + 1, data.kilometres.length - 1)] - data.kilometres[i]);
  };
  const prepared = (canvas) => {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, sans-serif";
    return { pen, width, height };
  };
  const scaleOf = (width, range) => {
    const inner = width - LEFT - RIGHT, per = inner / (range[1] - range[0]);
    return { inner, per, x: (distance) => LEFT + (distance - range[0]) * per };
  };
  const niceStep = (span, count) => {
    const raw = span / count, power = 10 ** Math.floor(Math.log10(raw));
    return power * [1, 2, 5, 10].find((one) => one * power >= raw);
  };
  const axis = (pen, width, height, scale, range) => {
    const step = niceStep(range[1] - range[0], Math.max(2, width / 110));
    pen.fillStyle = "#555";
    pen.textAlign = "center";
    for (let at = Math.ceil(range[0] / step) * step; at <= range[1]; at += step) {
      pen.fillStyle = "#e8e8e8";
      pen.fillRect(Math.round(scale.x(at)), TOP, 1, height - TOP - BOTTOM);
      pen.fillStyle = "#555";
      pen.fillText("km " + kilometre(at).toFixed(3), Math.min(scale.x(at), width - 30), height - 5);
    }
  };
  const trace = (pen, levels, first, spacing, scale, y, colour) => {
    const per = 1 / (scale.per * spacing); // points per pixel
    let chosen = levels[0];
    for (const one of levels) if (one.size <= per / 2) chosen = one;
    const from = Math.max(0, Math.floor((view[0] - first) / spacing / chosen.size) - 1);
    const to = Math.min(chosen.low.length - 1, Math.ceil((view[1] - first) / spacing / chosen.size) + 1);
    pen.strokeStyle = colour;
    pen.beginPath();
    let down = false;
    for (let i = from; i <= to; i++) {
      if (chosen.low[i] === -32768) { down = false; continue; }
      const x = scale.x(first + (i + (chosen.size - 1) / 2 / chosen.size) * chosen.size * spacing);
      if (down) pen.lineTo(x, y(chosen.low[i] * data.step)); else pen.moveTo(x, y(chosen.low[i] * data.step));
      if (chosen.high !== chosen.low) pen.lineTo(x, y(chosen.high[i] * data.step));
      down = true;
    }
    pen.stroke();
  };
  const interval = (pen, band, scale, y) => {
    if (!band.deviation) return;
    const per = 1 / (scale.per * band.spacing);
    let chosen = band.level[0];
    for (const one of band.level) if (one.size <= per) chosen = one;
    const from = Math.max(0, Math.floor((view[0] - band.first) / band.spacing / chosen.size) - 1);
    const to = Math.min(chosen.low.length - 1, Math.ceil((view[1] - band.first) / band.spacing / chosen.size) + 1);
    pen.fillStyle = "rgba(86,180,233,0.45)";
    const edge = (i, high) => {
      const place = Math.min(band.deviation.length - 1, Math.floor(((i + 0.5) * chosen.size) / data.every));
      const value = high ? chosen.high[i] : chosen.low[i];
      return y((value + (high ? 1.96 : -1.96) * band.deviation[place]) * data.step);
    };
    const x = (i) => scale.x(band.first + (i * chosen.size + (chosen.size - 1) / 2) * band.spacing);
    for (let i = from; i <= to; i++) {
      if (chosen.low[i] === -32768) continue;
      let end = i;
      while (end < to && chosen.low[end + 1] !== -32768) end++;
      pen.beginPath();
      for (let k = i; k <= end; k++) pen.lineTo(x(k), edge(k, true));
      for (let k = end; k >= i; k--) pen.lineTo(x(k), edge(k, false));
      pen.fill();
      i = end;
    }
  };
  const drawBand = (band) => {
    const { pen, width, height } = prepared(band.canvas), scale = scaleOf(width, view);
    const middle = (TOP + height - BOTTOM) / 2, half = (height - TOP - BOTTOM) / 2;
    const y = (millimetres) => middle - (half * millimetres) / band.most;
    axis(pen, width, height, scale, view);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP, scale.inner, 2 * half);
    pen.clip();
    pen.fillStyle = "rgba(120,120,120,0.28)";
    for (const [start, end] of band.untold) {
      if (end < view[0] || start > view[1]) continue;
      pen.fillRect(scale.x(start), TOP, Math.max(1, (end - start) * scale.per), 2 * half);
    }
    for (const [start, peak, end, , grade] of band.defects) {
      if (end < view[0] || start > view[1]) continue;
      pen.fillStyle = GRADES[grade] + (grade ? "55" : "33");
      pen.fillRect(scale.x(start), TOP, Math.max(1.5, (end - start) * scale.per), 2 * half);
      pen.fillStyle = GRADES[grade];
      pen.fillRect(scale.x(peak) - 1, TOP, 2, 6);
    }
    band.limits.forEach(([, limit], i) => {
      pen.strokeStyle = GRADES[Math.min(3, i + (band.limits.length === 3 ? 1 : 4 - band.limits.length))];
      pen.setLineDash([6, 4]);
      for (const sign of [1, -1]) {
        pen.beginPath();
        pen.moveTo(LEFT, y(sign * limit));
        pen.lineTo(width - RIGHT, y(sign * limit));
        pen.stroke();
      }
      pen.setLineDash([]);
    });
    interval(pen, band, scale, y);
    pen.lineWidth = 1;
    if (band.beside) trace(pen, band.beside, band.first, band.spacing, scale, y, "#8C8C8C");
    trace(pen, band.level, band.first, band.spacing, scale, y, "#0072B2");
    pen.restore();
    pen.fillStyle = "#555";
    pen.textAlign = "right";
    const step = niceStep(2 * band.most, 5);
    for (let at = -Math.floor(band.most / step) * step; at <= band.most; at += step) {
      pen.fillText(Number(at.toFixed(3)) + " mm", LEFT - 4, y(at) + 4);
    }
  };
  const drawSections = () => {
    if (!sections || !data.sections.rows.length) return;
    const { pen, width, height } = prepared(sections), scale = scaleOf(width, view);
    const most = 1.1 * Math.max(...data.sections.rows.map((row) => row[4]));
    const y = (millimetres) => height - BOTTOM - ((height - TOP - BOTTOM) * millimetres) / most;
    axis(pen, width, height, scale, view);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP, scale.inner, height - TOP - BOTTOM);
    pen.clip();
    for (const [start, end, value, low, high, grade] of data.sections.rows) {
      if (end < view[0] || start > view[1]) continue;
      pen.fillStyle = grade < 0 ? "#0072B2" : CLASSES[grade];
      pen.fillRect(scale.x(start), y(value), Math.max(1, (end - start) * scale.per - 0.5), y(0) - y(value));
      pen.fillStyle = "#333";
      if ((end - start) * scale.per > 4) pen.fillRect(scale.x((start + end) / 2), y(high), 1, y(low) - y(high));
    }
    pen.restore();
    pen.fillStyle = "#555";
    pen.textAlign = "right";
    const step = niceStep(most, 3);
    for (let at = 0; at <= most; at += step) pen.fillText(Number(at.toFixed(3)) + " mm", LEFT - 4, y(at) + 4);
  };
  const drawOverview = () => {
    const { pen, width, height } = prepared(overview), scale = scaleOf(width, whole);
    pen.fillStyle = "#f2f2f2";
    pen.fillRect(LEFT, 0, scale.inner, height);
    for (const band of bands) for (const [, peak, , , grade] of band.defects) {
      pen.fillStyle = GRADES[grade] + (grade ? "" : "66");
      pen.fillRect(scale.x(peak) - 0.5, height - 6 - 6 * grade, 1.5, 6 + 6 * grade);
    }
    pen.strokeStyle = "#0072B2";
    pen.lineWidth = 2;
    pen.strokeRect(scale.x(view[0]), 1, Math.max(3, (view[1] - view[0]) * scale.per), height - 2);
  };
  const draw = () => {
    waiting = false;
    const begun = performance.now();
    bands.forEach(drawBand);
    drawSections();
    drawOverview();
    document.documentElement.dataset.drawn = (performance.now() - begun).toFixed(1);
    const from = kilometre(view[0]).toFixed(3), to = kilometre(view[1]).toFixed(3);
    document.getElementById("range").textContent = `km ${from} to ${to}, ${(view[1] - view[0]).toFixed(0)} m`;
  };
  const show = (from, to, keep) => {
    let width = Math.max(LEAST, Math.min(to - from, whole[1] - whole[0]));
    let start = Math.max(whole[0], Math.min((from + to - width) / 2, whole[1] - width));
    view = [start, start + width];
    if (!keep) history.replaceState(null, "", `#at=${(start + width / 2).toFixed(1)}&span=${width.toFixed(0)}`);
    if (!waiting) { waiting = true; requestAnimationFrame(draw); }
  };
  const zoom = (factor, at) => {
    const centre = at === undefined ? (view[0] + view[1]) / 2 : at;
    show(centre - (centre - view[0]) * factor, centre + (view[1] - centre) * factor);
  };
  const follow = () => {
    const found = /at=([-\d.]+)(?:&span=([\d.]+))?/.exec(location.hash);
    if (!found) return show(...whole, true);
    const at = Number(found[1]), span = Number(found[2] || 200);
    show(at - span / 2, at + span / 2, true);
    document.getElementById("charts").scrollIntoView({ block: "start" });
  };
  const placeOf = (canvas, event) => {
    const box = canvas.getBoundingClientRect();
    return view[0] + ((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT)) * (view[1] - view[0]);
  };
  const read = (distance) => {
    const parts = bands.map((band) => {
      const i = Math.round((distance - band.first) / band.spacing), value = band.level[0].low[i];
      if (value === undefined || value === -32768) return `${band.name} –`;
      const spread = band.deviation ? band.deviation[Math.min(band.deviation.length - 1, Math.floor(i / data.every))] : 0;
      const wide = spread ? " ± " + (1.96 * spread * data.step).toFixed(2) : "";
      return `${band.name} ${(value * data.step).toFixed(2)}${wide} mm`;
    });
    document.getElementById("reading").textContent =
      `km ${kilometre(distance).toFixed(3)}, ${distance.toFixed(1)} m: ${parts.join(", ")}`;
  };
  for (const canvas of [...bands.map((band) => band.canvas), sections]) {
    if (!canvas) continue;
    let held = null;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(Math.exp(event.deltaY * 0.0015), placeOf(canvas, event));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      held = placeOf(canvas, event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = placeOf(canvas, event);
      if (held === null) return read(at);
      show(view[0] + held - at, view[1] + held - at);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
    canvas.addEventListener("dblclick", () => show(...whole));
  }
  overview.addEventListener("pointerdown", (event) => {
    const box = overview.getBoundingClientRect();
    const at = whole[0] + ((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT)) * (whole[1] - whole[0]);
    const half = Math.min((view[1] - view[0]) / 2, (whole[1] - whole[0]) / 20);
    show(at - half, at + half);
  });
  const span = () => view[1] - view[0];
  const actions = {
    in: () => zoom(0.5), out: () => zoom(2), all: () => show(...whole),
    left: () => show(view[0] - span() / 3, view[1] - span() / 3), right: () => show(view[0] + span() / 3, view[1] + span() / 3),
  };
  for (const button of document.querySelectorAll("[data-do]")) {
    button.addEventListener("click", () => actions[button.dataset.do]());
  }
  const keys = { "+": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", Home: "all" };
  document.getElementById("charts").addEventListener("keydown", (event) => {
    if (!(event.key in keys)) return;
    event.preventDefault();
    actions[keys[event.key]]();
  });
  const choice = document.getElementById("choice");
  if (choice) choice.addEventListener("change", () => {
    for (const row of document.querySelectorAll("#defects tbody tr")) {
      row.hidden = Number(row.dataset.grade) < Number(choice.value);
    }
  });
  window.addEventListener("hashchange", follow);
  window.addEventListener("resize", () => show(...view, true));
  follow();
})();
