// Questions to the server. What was asked lately is not asked again.

const KEPT = 60;
const answers = new Map(); // in the order of use

export class Refused extends Error {
  constructor(status, sentence) {
    super(sentence);
    this.status = status;
  }
}

function query(params) {
  const all = new URLSearchParams();
  for (const [name, value] of Object.entries(params)) {
    if (value !== undefined && value !== null && value !== "") all.set(name, value);
  }
  return all.toString();
}

/** The answer to a question, as an object; throws `Refused` with the server's sentence. */
export function ask(what, params = {}, signal = undefined) {
  const address = `/api/${what}?${query(params)}`;
  const known = answers.get(address);
  if (known) {
    answers.delete(address);
    answers.set(address, known);
    return Promise.resolve(known);
  }
  return fetched(address, { signal }).then((found) => {
    answers.set(address, found);
    if (answers.size > KEPT) answers.delete(answers.keys().next().value);
    return found;
  });
}

async function fetched(address, options) {
  let response;
  try {
    response = await fetch(address, { credentials: "same-origin", headers: { accept: "application/json" }, ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused(0, "The server does not answer.");
  }
  const body = await response.json().catch(() => ({}));
  if (!response.ok) throw new Refused(response.status, body.error || `The server answers ${response.status}.`);
  return body;
}

/** Whether this reader may ask. */
export const isOpen = () => fetched("/session", {}).then((found) => found.open);

/** Exchanges the token for a cookie that scripts cannot read. */
export async function logIn(token) {
  answers.clear();
  await fetched("/login", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }) });
}

export async function logOut() {
  answers.clear();
  await fetched("/logout", { method: "POST", headers: { "content-type": "application/json" }, body: "{}" });
}

/** Asks again, however lately it was asked. */
export const forget = () => answers.clear();
