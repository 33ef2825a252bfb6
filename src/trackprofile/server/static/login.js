// Asks for the token that the server was started with.

import { logIn } from "./api.js";
import { el, fill } from "./dom.js";

export function askForToken(root, done) {
  const field = el("input", { type: "password", id: "token", autocomplete: "current-password", required: true, maxlength: 500 });
  const said = el("p", { role: "alert", class: "error" });
  const form = el("form", {
    class: "login",
    onsubmit: async (event) => {
      event.preventDefault();
      try {
        await logIn(field.value.trim());
        field.value = "";
        done();
      } catch (error) {
        said.textContent = error.message;
        field.select();
      }
    },
  },
  el("h1", {}, "This store asks for a token"),
  el("p", {}, "It was printed where the server was started, or stands in its token file."),
  el("input", { type: "text", autocomplete: "username", value: "reader", hidden: true }),
  el("label", { for: "token" }, "Token"), field,
  el("button", { type: "submit" }, "Open"), said);
  fill(root, form);
  root.setAttribute("aria-busy", "false");
  field.focus();
}
