// Elements are made here and nowhere else, and text is only ever text: what a store holds is never read as markup.

/** An element with attributes, handlers (on...) and children; strings among them become text. */
export function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "class") node.className = value;
    else if (name === "value" || name === "checked" || name === "selected" || name === "disabled") node[name] = value;
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  add(node, children);
  return node;
}

/** Puts children in the place of whatever a node holds. */
export function fill(node, ...children) {
  node.replaceChildren();
  add(node, children);
  return node;
}

function add(node, children) {
  for (const child of children.flat(Infinity)) {
    if (child === undefined || child === null || child === false) continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
}

/** A choice of [value, words] pairs, with its name beside it. */
export function choice(name, options, chosen, onchange, attributes = {}) {
  const select = el("select", { "aria-label": name, onchange: () => onchange(select.value), ...attributes },
    options.map(([value, words]) => el("option", { value, selected: String(value) === String(chosen) }, words)));
  return el("label", { class: "choice" }, el("span", {}, name), select);
}

/** What has to be said with every number, to be closed if it is known. */
export function warnings(notes) {
  return notes.length > 0 && el("details", { class: "warning", open: true }, el("summary", {}, "To be said with every number"), el("ul", {}, notes.map((note) => el("li", {}, `${note}.`))));
}

/** A table of heads and rows of cells; a cell is a node, a text, or {number: text}. Names in narrow screens' cards. */
export function table(heads, rows, attributes = {}) {
  const cell = (one, index) => {
    const isNumber = one && typeof one === "object" && !(one instanceof Node) && "number" in one;
    const name = heads[index].name;
    return el(index ? "td" : "th", {
      scope: index ? undefined : "row", role: index ? "cell" : "rowheader", class: [isNumber && "number", heads[index].minor && "minor", heads[index].long && "long"].filter(Boolean).join(" "),
      "data-name": name,
    }, isNumber ? one.number : one);
  };
  return el("div", { class: "wide", tabindex: 0, role: "region", "aria-label": attributes.label },
    el("table", { id: attributes.id, role: "table" },
      attributes.label && el("caption", {}, attributes.label),
      el("thead", {}, el("tr", {}, heads.map((one) =>
        el("th", { scope: "col", class: [one.number && "number", one.minor && "minor"].filter(Boolean).join(" ") }, one.name)))),
      el("tbody", {}, rows.map((row) => el("tr", { class: row.mark || "", role: "row" }, row.cells.map(cell))))));
}
