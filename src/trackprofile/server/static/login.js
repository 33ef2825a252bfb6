// The form that asks for the server's token.

import { logIn } from "./api.js";
import { el, fill } from "./dom.js";

export function askForToken(root, done) {
  const field = el("input", { type: "password", id: "token", autocomplete: "current-password", required: true, maxlength: 500 });
  const message = el("p", { role: "alert", class: "error" });
  const form = el("form", {
    class: "login",
    onsubmit: async (event) => {
      event.preventDefault();
      try {
        await logIn(field.value.trim());
        field.value = "";
        done();
      } catch (error) {
        message.textContent = error.message;
        field.select();
      }
    },
  },
  el("h1", {}, "This server requires a token"),
  el("p", {}, "The server printed it when it was started, or it is in its token file."),
  el("input", { type: "text", autocomplete: "username", value: "reader", hidden: true }),
  el("label", { for: "token" }, "Token"), field,
  el("button", { type: "submit" }, "Log in"), message);
  fill(root, form);
  root.setAttribute("aria-busy", "false");
  field.focus();
}
