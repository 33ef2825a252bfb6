// The charts of the report: levels of all bands over one distance axis, standard deviations per section, the whole line.

import { levelChart, sectionChart } from "./charts.js";
import { levelAt } from "./envelope.js";
import { kmDigits, levelText, number } from "./format.js";
import { envelopeOf, pyramid, unpacked } from "./pyramid.js";
import { kilometreOf, stretchOf } from "./report-address.js";
import { addPicking, drawSchematic } from "./schematic.js";
import { afterKey, clamped } from "./view.js";

const GROUP = "report"; // of charts that share the cursor
const PRINT_WIDTH_PX = 680;
const data = JSON.parse(document.getElementById("data").textContent);
const whole = [data.start_m, data.end_m];
const levels = data.bands.map((band) => levelOf(band, band.level)), compared = data.bands.map((band) => band.compared && levelOf(band, band.compared));
let view = whole.slice(), isWaiting = false, box = null;

function levelOf({ first_m, spacing_m, standard_deviation: deviation }, level) {
  return {
    copies: pyramid(unpacked(level)), deviation: unpacked(deviation), deviation_stride: data.deviation_stride, unit_mm: data.unit_mm, first_m, spacing_m,
  };
}

const chainage = (distance, step = 1) => `km ${number(kilometreOf(data, distance), kmDigits(step))}`;
const port = { view: () => view, whole: () => whole, show, point: read, pick: () => {} };
const containers = data.bands.map((band) => document.getElementById(`chart-${band.name}`));
const charts = containers.map((container, i) => levelChart(container, { port, chainage, group: GROUP, bare: i < data.bands.length - 1, hasCompared: Boolean(compared[i]) }));
const sectionContainer = document.getElementById("chart-sections");
const sections = sectionContainer && sectionChart(sectionContainer, { port, chainage, group: GROUP });
const overview = document.getElementById("overview");

function draw() {
  isWaiting = false;
  const begin = performance.now(), pixels = 2 * Math.max(200, containers[0].clientWidth);
  charts.forEach((chart, i) => {
    const band = data.bands[i], envelope = { ...envelopeOf(levels[i], view, pixels), not_assessed: band.not_assessed };
    chart.update({ envelope, compared: compared[i] ? envelopeOf(compared[i], view, pixels) : null, view, limits: band.limits, defects: band.defects.filter((one) => one.end_m >= view[0] && one.start_m <= view[1]) });
  });
  sections?.update({ sections: data.sections, view });
  box = drawSchematic(overview, { whole, view, marks: data.bands.flatMap((band) => band.defects), chainage });
  document.documentElement.dataset.drawn = (performance.now() - begin).toFixed(1);
  document.getElementById("range").textContent = `${chainage(view[0])} to ${number(kilometreOf(data, view[1]), 3)}, ${number(view[1] - view[0], 0)} m`;
}

function show(next, { keepAddress = false } = {}) {
  view = clamped(next, whole);
  const length = view[1] - view[0];
  if (!keepAddress) history.replaceState(null, "", `#at=${(view[0] + length / 2).toFixed(1)}&span=${length.toFixed(0)}`);
  if (isWaiting) return;
  isWaiting = true;
  requestAnimationFrame(draw);
}

/** Shows the values under the pointer. */
function read(distance) {
  if (distance === null) return;
  const parts = data.bands.map((band, i) => {
    const level = levelAt(envelopeOf(levels[i], [distance, distance], 1e9), distance);
    return `${band.name} ${level ? levelText(level) : "not known"}`;
  });
  document.getElementById("reading").textContent = `${chainage(distance)}, ${number(distance, 1)} m: ${parts.join(", ")}`;
}

/** Shows the stretch of the address; an address of another part of the report changes nothing. */
function followAddress() {
  const stretch = stretchOf(location.hash);
  show(stretch || view, { keepAddress: true });
  if (stretch) document.getElementById("charts").scrollIntoView({ block: "start" });
}

function addControls() {
  for (const button of document.querySelectorAll("[data-key]")) button.addEventListener("click", () => show(afterKey(button.dataset.key, view, whole)));
  document.getElementById("charts").addEventListener("keydown", (event) => {
    const next = event.ctrlKey || event.metaKey || event.altKey ? null : afterKey(event.key, view, whole);
    if (!next) return;
    event.preventDefault();
    show(next);
  });
  addPicking(overview, () => box, () => whole, (distance) => {
    const half = Math.min((view[1] - view[0]) / 2, (whole[1] - whole[0]) / 20);
    show([distance - half, distance + half]);
  });
  const choice = document.getElementById("choice");
  choice?.addEventListener("change", () => {
    for (const row of document.querySelectorAll("#defects tbody tr")) row.hidden = Number(row.dataset.grade) < Number(choice.value);
  });
  window.addEventListener("hashchange", followAddress);
  window.addEventListener("resize", () => show(view, { keepAddress: true }));
  // Canvases keep their width when the browser lays the report out for paper.
  const setWidth = (width) => [...containers, sectionContainer, overview].forEach((one) => { if (one) one.style.width = width; });
  window.addEventListener("beforeprint", () => { setWidth(`${PRINT_WIDTH_PX}px`); for (const chart of [...charts, sections]) chart?.resize(); draw(); });
  window.addEventListener("afterprint", () => { setWidth(""); show(view, { keepAddress: true }); });
}

addControls();
followAddress();
