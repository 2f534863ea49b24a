// Texts of numbers. Unknown is a word or a dash, never 0.

export const UNKNOWN = "unknown";

/** A number with fixed decimals, without "-0"; `unknown` for null and NaN. */
export function fixed(value, decimals, unknown = "–") {
  if (value === null || value === undefined || !Number.isFinite(value)) return unknown;
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text;
}

/** The same with its sign. */
export function signed(value, decimals) {
  const text = fixed(value, decimals);
  return Number(text) > 0 ? `+${text}` : text.replace("-", "−");
}

/** "1.234 ± 0.012" with its standard deviation, which may be unknown; as many decimals as a small deviation needs. */
export function withDeviation(value, deviation) {
  if (fixed(value, 3, "") === "") return UNKNOWN;
  const decimals = deviation > 0 ? Math.min(Math.max(3, Math.ceil(-Math.log10(deviation))), 6) : 3;
  return `${fixed(value, decimals).replace("-", "−")} ± ${fixed(deviation, decimals, "?")}`;
}

/** "1 scan", "2 scans". */
export function counted(count, thing) {
  return `${count} ${thing}${count === 1 ? "" : "s"}`;
}

/** The smallest of 1, 2, 5 times a power of ten that is not below a value > 0. */
export function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value * (1 - 1e-9));
}

/** Multiples of 1, 2 or 5 times a power of ten from `low` to `high`, about `count` of them. */
export function ticks(low, high, count) {
  const step = nice((high - low) / count);
  const found = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index += 1) found.push(index * step);
  return found;
}

/** Text of a tick, with as many decimals as the step needs. */
export function tickText(value, values) {
  const step = values.length > 1 ? values[1] - values[0] : 1;
  return fixed(value, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))).replace("-", "−");
}
