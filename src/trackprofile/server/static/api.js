// Requests to the server. Recent answers are kept.

const KEPT_ANSWERS = 60;
const answers = new Map(); // the least recently used first

/** An answer that is an error; the message is the server's sentence. */
export class RequestError extends Error {
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

/** The answer of an endpoint, as an object. Throws `RequestError`. */
export async function request(endpoint, params = {}, signal = undefined) {
  const address = `/api/${endpoint}?${query(params)}`;
  const answer = answers.get(address) ?? await fetched(address, { signal });
  answers.delete(address);
  answers.set(address, answer);
  if (answers.size > KEPT_ANSWERS) answers.delete(answers.keys().next().value);
  return answer;
}

async function fetched(address, options) {
  let response;
  try {
    response = await fetch(address, { credentials: "same-origin", headers: { accept: "application/json" }, ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new RequestError(0, "The server does not answer.");
  }
  const body = await response.json().catch(() => ({}));
  if (!response.ok) throw new RequestError(response.status, body.error || `The server answers ${response.status}.`);
  return body;
}

/** Whether this browser may read the store. */
export const hasAccess = () => fetched("/session", {}).then((answer) => answer.open);

const post = (address, body) => fetched(address, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

/** Exchanges the token for a cookie that scripts cannot read. */
export async function logIn(token) {
  answers.clear();
  await post("/login", { token });
}

export async function logOut() {
  answers.clear();
  await post("/logout", {});
}

/** Forgets all answers, so that the next request goes to the server. */
export const forget = () => answers.clear();
