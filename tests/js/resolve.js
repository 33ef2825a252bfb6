// The server serves `reporting/web` as `/static/shared/`; this hook finds the same files for node.

import { register } from "node:module";

const shared = new URL("../../src/trackprofile/reporting/web/", import.meta.url);

register(`data:text/javascript,${encodeURIComponent(`
export function resolve(specifier, context, next) {
  const name = /^\\.\\/shared\\/([\\w-]+\\.js)$/.exec(specifier)?.[1];
  return next(name ? new URL(name, ${JSON.stringify(shared.href)}).href : specifier, context);
}`)}`);
