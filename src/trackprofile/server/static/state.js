// What is looked at, all of it, stands in the address: it can be shared, and back and forward work.

const KEYS = ["view", "line", "direction", "day", "entry", "band", "from", "to", "at", "since", "other", "least", "only", "order", "page"];
const NUMBERS = new Set(["from", "to", "at", "page"]);
const VIEWS = ["line", "defects", "place", "compare", "quality"];

/** The state that an address holds; what cannot be one is left out. */
export function parsed(search) {
  const params = new URLSearchParams(search), state = {};
  for (const key of KEYS) {
    const text = params.get(key);
    if (text === null || text === "" || text.length > 200) continue;
    if (NUMBERS.has(key)) {
      const value = Number(text);
      if (Number.isFinite(value)) state[key] = value;
    } else state[key] = text;
  }
  if (!VIEWS.includes(state.view)) state.view = "line";
  return state;
}

/** The address of a state. */
export function address(state) {
  const params = new URLSearchParams();
  for (const key of KEYS) {
    const value = state[key];
    if (value === undefined || value === null || value === "") continue;
    params.set(key, NUMBERS.has(key) ? String(Math.round(value * 100) / 100) : value);
  }
  return `/?${params}`;
}

/** The state with some of it changed; undefined takes a key away. */
export function changed(state, patch) {
  const next = { ...state, ...patch };
  for (const key of Object.keys(next)) if (next[key] === undefined) delete next[key];
  return next;
}
