// The application: what can be chosen, which view is shown, and the address that holds both.

import { RequestError, forget, hasAccess, logOut, request } from "./api.js";
import { button, choice, el, fill } from "./dom.js";
import { askForToken } from "./login.js";
import { addressOf, changedState, parsedState } from "./state.js";
import * as compareView from "./view-compare.js";
import * as defectsView from "./view-defects.js";
import * as lineView from "./view-line.js";
import * as locationView from "./view-location.js";
import * as qualityView from "./view-quality.js";

const VIEWS = { line: ["Line", lineView], defects: ["Defects", defectsView], location: ["Location", locationView], compare: ["Two dates", compareView], quality: ["Data quality", qualityView] };

const main = document.getElementById("main"), message = document.getElementById("message");
const app = {
  state: {}, bands: [], lines: [],
  /** The chosen line and direction. */
  line: () => app.lines.find((one) => one.line === app.state.line && one.direction === app.state.direction),
  whole: () => [app.line().start_m, app.line().end_m],
  /** Days with passes, the earliest first; the passes of the chosen day. */
  days: [], passes: [],
  /** Parameters that most requests share. */
  selection: () => ({ line: app.state.line, direction: app.state.direction, day: app.state.day, entry: app.state.entry }),
  href: (patch) => addressOf(changedState(app.state, patch)),
  go, note, report, setBusy, reportFailure,
};
let shown = null, turn = 0;

/** Shows a sentence above the view, or none. */
function report(sentence) {
  message.hidden = !sentence;
  message.textContent = sentence || "";
}

function setBusy(isBusy) {
  main.setAttribute("aria-busy", String(isBusy));
  if (!isBusy) performance.mark("drawn");
}

/** Shows the sentence of a failed request; an aborted request is no failure. */
function reportFailure(error) {
  if (error.name === "AbortError") return;
  report(error.message);
  setBusy(false);
}

/** Goes to a changed state; `replace` where the old one should not be in the browser's history. */
function go(patch, { replace = false } = {}) {
  const next = addressOf(changedState(app.state, patch));
  if (next !== location.pathname + location.search) history[replace ? "replaceState" : "pushState"](null, "", next);
  return render();
}

/** Writes into the address what a view has changed by itself. */
function note(patch) {
  app.state = changedState(app.state, patch);
  history.replaceState(null, "", addressOf(app.state));
  fillViews();
}

function handleFailure(error) {
  if (error.name === "AbortError") return;
  setBusy(false);
  if (error instanceof RequestError && error.status === 401) {
    shown = null;
    fill(document.getElementById("choices"));
    fill(document.getElementById("views"));
    report("");
    askForToken(main, () => { forget(); app.lines = []; render(); });
    return;
  }
  report(error.message);
  if (!(error instanceof RequestError)) console.error(error);
}

async function render() {
  const own = ++turn;
  setBusy(true);
  try {
    app.state = parsedState(location.search);
    await complete();
    if (own !== turn) return;
    fillHeader();
    report("");
    if (!app.lines.length) return showEmptyStore();
    await showView();
  } catch (error) {
    if (own === turn) handleFailure(error);
  }
}

/** Completes what the address leaves open: the first line, its latest day. */
async function complete() {
  if (!app.lines.length) {
    if (!(await hasAccess())) throw new RequestError(401, "");
    const answer = await request("lines");
    app.lines = answer.lines;
    app.bands = answer.bands;
    app.tokenRequired = answer.token_required;
    if (!app.lines.length) return;
  }
  const { state } = app;
  state.line ??= app.lines[0].line;
  state.direction ??= (app.lines.find((one) => one.line === state.line) || app.lines[0]).direction;
  state.band = app.bands.some((one) => one.name === state.band) ? state.band : app.bands[0].name;
  if (!app.line()) {
    fillHeader();
    throw new RequestError(404, `The store contains no line “${state.line}” in direction “${state.direction}”; choose another.`);
  }
  const { line, direction } = state;
  app.days = (await request("days", { line, direction })).days;
  state.day = app.days.includes(state.day) ? state.day : app.days[app.days.length - 1];
  app.passes = (await request("passes", { line, direction, first: state.day, last: state.day })).passes;
  const full = addressOf(state);
  if (full !== location.pathname + location.search) history.replaceState(null, "", full);
}

async function showView() {
  const [name, view] = VIEWS[app.state.view], { state } = app;
  document.title = `${state.line} ${state.direction}, ${name.toLowerCase()}, ${state.day} – trackprofile`;
  if (shown?.view !== view) {
    shown?.part.leave?.();
    fill(main);
    shown = { view, part: view.mount(main, app) };
  }
  await shown.part.update(state);
}

function showEmptyStore() {
  shown = null;
  fill(main, el("p", {}, "The store contains no pass yet. Add one with ", el("code", {}, "trackprofile store add"), ", then reload."));
  setBusy(false);
}

/** Choices of line, direction, day and pass, and the views. */
function fillHeader() {
  const { state } = app, box = document.getElementById("choices");
  const focused = document.activeElement?.dataset?.choice;
  if (!app.lines.length) return;
  const names = [...new Set(app.lines.map((one) => one.line))];
  const directions = app.lines.filter((one) => one.line === state.line).map((one) => one.direction);
  const fresh = { day: undefined, entry: undefined, from: undefined, to: undefined, at: undefined, since: undefined, compared_day: undefined, page: undefined };
  const pick = (name, options, value, then) => choice(name, options, value, then, { "data-choice": name });
  fill(box,
    el("strong", { class: "brand" }, "trackprofile"),
    pick("Line", names.map((one) => [one, one]), state.line, (line) => go({ ...fresh, line, direction: undefined })),
    pick("Direction", directions.map((one) => [one, one]), state.direction, (direction) => go({ ...fresh, direction })),
    dayChoice(pick), passChoice(pick),
    app.tokenRequired && el("button", { type: "button", class: "quiet", onclick: () => logOut().then(() => { app.lines = []; render(); }, handleFailure) }, "Log out"));
  fillViews();
  document.querySelector("#views [aria-current]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  if (focused) box.querySelector(`[data-choice="${focused}"]`)?.focus();
}

function fillViews() {
  fill(document.getElementById("views"), Object.entries(VIEWS).map(([key, [name]]) =>
    el("a", { href: app.href({ view: key, page: undefined }), "aria-current": key === app.state.view ? "page" : undefined }, name)));
}

function dayChoice(pick) {
  const { days } = app, at = days.indexOf(app.state.day);
  const step = (by, name, sign) => button(name, sign, () => go({ day: days[at + by], entry: undefined }), { disabled: !days[at + by] });
  return days.length > 0 && el("span", { class: "joined" },
    pick("Date", [...days].reverse().map((one) => [one, one]), app.state.day, (day) => go({ day, entry: undefined })),
    step(-1, "earlier date", "‹"), step(1, "later date", "›"));
}

function passChoice(pick) {
  const { passes } = app, { entry } = app.state, isOlder = entry && !passes.some((one) => one.entry === entry);
  if (passes.length < 2 && !isOlder) return null;
  const text = (one) => [one.run, one.vehicle, `km ${(one.start_m / 1000).toFixed(1)}–${(one.end_m / 1000).toFixed(1)}`].filter(Boolean).join(", ");
  return pick("Pass", [["", `all ${passes.length} of the day`], ...passes.map((one) => [one.entry, text(one)]), ...(isOlder ? [[entry, `earlier version ${entry.slice(0, 8)}`]] : [])],
    entry || "", (chosen) => go({ entry: chosen || undefined }));
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
