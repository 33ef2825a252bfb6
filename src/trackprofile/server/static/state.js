// The address holds the state of the viewer: it can be shared, and back and forward work.

const KEYS = ["view", "line", "direction", "day", "entry", "band", "from", "to", "at", "since", "compared_day", "minimum_action", "band_filter", "order", "page"];
const NUMBERS = new Set(["from", "to", "at", "page"]);
const VIEWS = ["line", "defects", "location", "compare", "quality"];
const MAX_TEXT = 200;

/** The state in the query of an address; invalid values are omitted. */
export function parsedState(query) {
  const params = new URLSearchParams(query), state = {};
  for (const key of KEYS) {
    const text = params.get(key);
    if (text === null || text === "" || text.length > MAX_TEXT) continue;
    if (NUMBERS.has(key)) {
      const value = Number(text);
      if (Number.isFinite(value)) state[key] = value;
    } else state[key] = text;
  }
  if (!VIEWS.includes(state.view)) state.view = "line";
  return state;
}

/** The address of a state. */
export function addressOf(state) {
  const params = new URLSearchParams();
  for (const key of KEYS) {
    const value = state[key];
    if (value === undefined || value === null || value === "") continue;
    params.set(key, NUMBERS.has(key) ? String(Math.round(value * 100) / 100) : value);
  }
  return `/?${params}`;
}

/** The state with some keys changed; undefined removes a key. */
export function changedState(state, patch) {
  const next = { ...state, ...patch };
  for (const key of Object.keys(next)) if (next[key] === undefined) delete next[key];
  return next;
}
