// The page: what can be chosen, which view is shown, and the address that says both.

import { Refused, ask, forget, isOpen, logOut } from "./api.js";
import { choice, el, fill } from "./dom.js";
import { askForToken } from "./login.js";
import { address, changed, parsed } from "./state.js";
import * as compare from "./view-compare.js";
import * as defects from "./view-defects.js";
import * as lineView from "./view-line.js";
import * as place from "./view-place.js";
import * as quality from "./view-quality.js";

const VIEWS = { line: ["Line", lineView], defects: ["Exceedances", defects], place: ["Place", place], compare: ["Two dates", compare], quality: ["Data quality", quality] };

const main = document.getElementById("main"), message = document.getElementById("message");
const app = {
  state: {}, bands: [], lines: [],
  /** The line and direction that are chosen. */
  line: () => app.lines.find((one) => one.line === app.state.line && one.direction === app.state.direction),
  whole: () => [app.line().start_m, app.line().end_m],
  /** Days with passes, the earliest first; the passes of the day that is chosen. */
  days: [], passes: [],
  /** What every question names. */
  where: () => ({ line: app.state.line, direction: app.state.direction, day: app.state.day, entry: app.state.entry }),
  href: (patch) => address(changed(app.state, patch)),
  go, note, say, busy,
};
let shown = null, turn = 0;

function say(sentence) {
  message.hidden = !sentence;
  message.textContent = sentence || "";
}

function busy(is) {
  main.setAttribute("aria-busy", String(is));
  if (!is) performance.mark("drawn");
}

/** Goes to a changed state; `replace` where it is no step that one goes back from. */
function go(patch, { replace = false } = {}) {
  const next = address(changed(app.state, patch));
  if (next !== location.pathname + location.search) history[replace ? "replaceState" : "pushState"](null, "", next);
  return render();
}

/** Writes into the address what a view has changed by itself. */
function note(patch) {
  app.state = changed(app.state, patch);
  history.replaceState(null, "", address(app.state));
  views();
}

function failed(error) {
  if (error.name === "AbortError") return;
  busy(false);
  if (error instanceof Refused && error.status === 401) {
    shown = null;
    fill(document.getElementById("choices"));
    fill(document.getElementById("views"));
    say("");
    askForToken(main, () => { forget(); app.lines = []; render(); });
    return;
  }
  say(error.message);
  if (!(error instanceof Refused)) console.error(error);
}

async function render() {
  const mine = ++turn;
  busy(true);
  try {
    app.state = parsed(location.search);
    await choose();
    if (mine !== turn) return;
    header();
    say("");
    if (!app.lines.length) return empty();
    await show();
  } catch (error) {
    if (mine === turn) failed(error);
  }
}

/** Fills what the address leaves open: the first line, its latest day. */
async function choose() {
  if (!app.lines.length) {
    if (!(await isOpen())) throw new Refused(401, "");
    const found = await ask("lines");
    app.lines = found.lines;
    app.bands = found.bands;
    app.locked = found.locked;
    if (!app.lines.length) return;
  }
  const { state } = app;
  state.line ??= app.lines[0].line;
  state.direction ??= (app.lines.find((one) => one.line === state.line) || app.lines[0]).direction;
  state.band = app.bands.some((one) => one.name === state.band) ? state.band : app.bands[0].name;
  if (!app.line()) {
    header();
    throw new Refused(404, `The store holds no line “${state.line}” in direction “${state.direction}”; choose another.`);
  }
  const { line, direction } = state;
  app.days = (await ask("days", { line, direction })).days;
  state.day = app.days.includes(state.day) ? state.day : app.days[app.days.length - 1];
  app.passes = (await ask("passes", { line, direction, first: state.day, last: state.day })).passes;
  const full = address(state);
  if (full !== location.pathname + location.search) history.replaceState(null, "", full);
}

async function show() {
  const [name, view] = VIEWS[app.state.view], { state } = app;
  document.title = `${state.line} ${state.direction}, ${name.toLowerCase()}, ${state.day} – trackprofile`;
  if (shown?.view !== view) {
    shown?.part.leave?.();
    fill(main);
    shown = { view, part: view.mount(main, app) };
  }
  await shown.part.update(state);
}

function empty() {
  shown = null;
  fill(main, el("p", {}, "The store holds no pass yet. Add one with ", el("code", {}, "trackprofile store add"), ", then reload."));
  busy(false);
}

/** Lines, direction, day and pass to choose from, and the views. */
function header() {
  const { state } = app, box = document.getElementById("choices");
  const focused = document.activeElement?.dataset?.choice;
  if (!app.lines.length) return;
  const names = [...new Set(app.lines.map((one) => one.line))];
  const directions = app.lines.filter((one) => one.line === state.line).map((one) => one.direction);
  const fresh = { day: undefined, entry: undefined, from: undefined, to: undefined, at: undefined, since: undefined, other: undefined, page: undefined };
  const pick = (name, options, value, then) => choice(name, options, value, then, { "data-choice": name });
  fill(box,
    el("strong", { class: "brand" }, "trackprofile"),
    pick("Line", names.map((one) => [one, one]), state.line, (line) => go({ ...fresh, line, direction: undefined })),
    pick("Direction", directions.map((one) => [one, one]), state.direction, (direction) => go({ ...fresh, direction })),
    dayChoice(pick), passChoice(pick),
    app.locked && el("button", { type: "button", class: "quiet", onclick: () => logOut().then(() => { app.lines = []; render(); }, failed) }, "Log out"));
  views();
  document.querySelector("#views [aria-current]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  if (focused) box.querySelector(`[data-choice="${focused}"]`)?.focus();
}

function views() {
  fill(document.getElementById("views"), Object.entries(VIEWS).map(([key, [name]]) =>
    el("a", { href: app.href({ view: key, page: undefined }), "aria-current": key === app.state.view ? "page" : undefined }, name)));
}

function dayChoice(pick) {
  const { days } = app, at = days.indexOf(app.state.day);
  const step = (by, name, sign) => el("button", {
    type: "button", "aria-label": name, title: name, disabled: !days[at + by], onclick: () => go({ day: days[at + by], entry: undefined }),
  }, sign);
  return days.length > 0 && el("span", { class: "joined" },
    pick("Date", [...days].reverse().map((one) => [one, one]), app.state.day, (day) => go({ day, entry: undefined })),
    step(-1, "earlier date", "‹"), step(1, "later date", "›"));
}

function passChoice(pick) {
  const { passes } = app, { entry } = app.state, older = entry && !passes.some((one) => one.entry === entry);
  if (passes.length < 2 && !older) return null;
  const words = (one) => [one.run, one.vehicle, `km ${(one.start_m / 1000).toFixed(1)}–${(one.end_m / 1000).toFixed(1)}`].filter(Boolean).join(", ");
  return pick("Pass", [["", `all ${passes.length} of the day`], ...passes.map((one) => [one.entry, words(one)]), ...(older ? [[entry, `earlier version ${entry.slice(0, 8)}`]] : [])],
    entry || "", (one) => go({ entry: one || undefined }));
}

document.addEventListener("click", (event) => {
  const link = event.target.closest?.('a[href^="/?"]');
  if (!link || event.button || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
  event.preventDefault();
  history.pushState(null, "", link.getAttribute("href"));
  render().then(() => link.dataset.top !== undefined && window.scrollTo(0, 0));
});
window.addEventListener("popstate", render);
window.addEventListener("resize", () => shown?.part.draw?.());
render();
