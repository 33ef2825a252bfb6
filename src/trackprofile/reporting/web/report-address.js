// Kilometres and addresses of the report.

const LINK_LENGTH_M = 200;

/** Kilometre of a distance, from the table of the line. */
export function kilometreOf({ start_m: start, chainage_step_m: step, chainage_km: table }, distance) {
  const at = Math.max(0, Math.min((distance - start) / step, table.length - 1.001)), i = Math.floor(at);
  return table[i] + (at - i) * (table[Math.min(i + 1, table.length - 1)] - table[i]);
}

/** The stretch of an address such as "#at=1650&span=200"; null without one. */
export function stretchOf(hash) {
  const match = /at=(-?[\d.]+)(?:&span=([\d.]+))?/.exec(hash);
  if (!match) return null;
  const at = Number(match[1]), length = Number(match[2] || LINK_LENGTH_M);
  return [at - length / 2, at + length / 2];
}
