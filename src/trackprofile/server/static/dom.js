// All elements are made here, and text stays text: what a store contains is never read as markup.

/** An element with attributes, handlers (on...) and children; strings become text nodes. */
export function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "class") node.className = value;
    else if (name === "value" || name === "checked" || name === "selected" || name === "disabled") node[name] = value;
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  append(node, children);
  return node;
}

/** Replaces the children of a node. */
export function fill(node, ...children) {
  node.replaceChildren();
  append(node, children);
  return node;
}

function append(node, children) {
  for (const child of children.flat(Infinity)) {
    if (child === undefined || child === null || child === false) continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
}

/** A choice of [value, text] pairs with its name. */
export function choice(name, options, chosen, onchange, attributes = {}) {
  const select = el("select", { "aria-label": name, onchange: () => onchange(select.value), ...attributes },
    options.map(([value, text]) => el("option", { value, selected: String(value) === String(chosen) }, text)));
  return el("label", { class: "choice" }, el("span", {}, name), select);
}

/** The choice of a band. */
export const bandChoice = (app) => choice("Band", app.bands.map((band) => [band.name, `${band.name}, ${band.shortest_m}–${band.longest_m} m`]), app.state.band, (band) => app.go({ band }));

/** A button with an accessible name. */
export const button = (name, text, onclick, attributes = {}) => el("button", { type: "button", "aria-label": name, title: name, onclick, ...attributes }, text);

/** A container of a chart, with its accessible name. */
export const chartBox = (name, size = "strip") => el("div", { class: size, role: "img", "aria-label": name });

/** Caveats on the assessment, closed until they are asked for. */
export function caveats(notes) {
  return notes.length > 0 && el("details", { class: "caveats" },
    el("summary", {}, `${notes.length === 1 ? "1 caveat applies" : `${notes.length} caveats apply`} to limits and assessment`),
    el("ul", {}, notes.map((note) => el("li", {}, `${note}.`))));
}

/** A table of heads and rows of cells; a cell is a node, a text, or {number: text}. On narrow screens rows become cards. */
export function table(heads, rows, attributes = {}) {
  const cell = (content, index) => {
    const isNumber = content && typeof content === "object" && !(content instanceof Node) && "number" in content;
    const { name, minor, long } = heads[index];
    return el(index ? "td" : "th", {
      scope: index ? undefined : "row", role: index ? "cell" : "rowheader", class: [isNumber && "number", minor && "minor", long && "long"].filter(Boolean).join(" "),
      "data-name": name,
    }, isNumber ? content.number : content);
  };
  return el("div", { class: "wide", tabindex: 0, role: "region", "aria-label": attributes.label },
    el("table", { id: attributes.id, role: "table" },
      attributes.label && el("caption", {}, attributes.label),
      el("thead", {}, el("tr", {}, heads.map((head) =>
        el("th", { scope: "col", class: [head.number && "number", head.minor && "minor"].filter(Boolean).join(" ") }, head.name)))),
      el("tbody", {}, rows.map((row) => el("tr", { class: row.mark || "", role: "row" }, row.cells.map(cell))))));
}

/** A field for a kilometre; `go(distance)` gets metres within the line, `refuse(sentence)` what is wrong. */
export function kilometreForm({ name, value = "", whole, go, refuse }) {
  const field = el("input", { type: "text", inputmode: "decimal", size: 9, value, "aria-label": name, placeholder: "12.345" });
  return el("form", { class: "jump", onsubmit: (event) => {
    event.preventDefault();
    const distance = parsedKilometre(field.value), [start, end] = whole();
    if (distance >= start && distance <= end) go(distance);
    else refuse(`Enter a kilometre from ${(start / 1000).toFixed(3)} to ${(end / 1000).toFixed(3)}.`);
  } }, el("label", {}, "km ", field), el("button", { type: "submit" }, "Go"));
}

/** Metres of a kilometre as typed: "12.345", "12,345" or "km 12.345"; NaN from anything else. */
export function parsedKilometre(text) {
  const digits = text.replace(",", ".").replace(/^\s*km/i, "").trim();
  return digits ? 1000 * Number(digits) : NaN;
}
