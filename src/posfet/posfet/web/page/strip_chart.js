// Strip charts: forces over the last seconds, with the band of two standard deviations. Gaps where a force is unknown.

import { fitted, themed } from "./canvas.js";
import { nice, tickText, ticks } from "./numbers.js";

export const SPAN = 20; // [s]
const LEFT = 38, RIGHT = 6, TOP = 6, BOTTOM = 20, LEAST = 0.05;
const LONGEST_STEP = 0.5; // a longer time without a value is a gap [s]

/** Values over time of one line, for the last `SPAN` seconds. */
export class Series {
  constructor(colourNow) {
    this.colourNow = colourNow; // a function: the theme may change
    this.points = [];
  }

  add(time, value, deviation) {
    this.points.push({ time, value: value ?? NaN, deviation: deviation ?? NaN });
    while (this.points.length && this.points[0].time < time - SPAN) this.points.shift();
  }

  get empty() {
    return !this.points.length;
  }

  forget(time) {
    while (this.points.length && this.points[0].time < time - SPAN) this.points.shift();
  }

  clear() {
    this.points = [];
  }
}

/** Draws lines up to the time `now` [s]. */
export function drawChart(canvas, series, now) {
  const { context, width, height } = fitted(canvas);
  const theme = themed();
  let low = 0, high = LEAST;
  for (const { points } of series) {
    for (const { value, deviation } of points) {
      if (Number.isNaN(value)) continue;
      const band = Number.isNaN(deviation) ? 0 : 2 * deviation;
      low = Math.min(low, value - band);
      high = Math.max(high, value + band);
    }
  }
  high = nice(high);
  low = low < -0.02 * high ? -nice(-low) : low < 0 ? -0.06 * high : 0;
  const x = (time) => width - RIGHT - ((now - time) / SPAN) * (width - LEFT - RIGHT);
  const y = (value) => TOP + ((high - value) / (high - low)) * (height - TOP - BOTTOM);
  grid(context, width, height, low, high, x, y, now, theme);
  context.save();
  context.beginPath();
  context.rect(LEFT, 0, width - LEFT - RIGHT, height - BOTTOM + 2);
  context.clip();
  for (const { points, colourNow } of series) {
    for (const part of parts(points)) drawPart(context, part, colourNow(), x, y);
  }
  context.restore();
}

function drawPart(context, part, colour, x, y) {
  const banded = part.filter((point) => !Number.isNaN(point.deviation));
  context.beginPath();
  for (const point of banded) context.lineTo(x(point.time), y(point.value + 2 * point.deviation));
  for (const point of banded.toReversed()) context.lineTo(x(point.time), y(point.value - 2 * point.deviation));
  context.fillStyle = colour;
  context.globalAlpha = 0.24;
  context.fill();
  context.globalAlpha = 1;
  context.beginPath();
  for (const point of part) context.lineTo(x(point.time), y(point.value));
  context.strokeStyle = colour;
  context.lineWidth = 1.8;
  context.lineJoin = "round";
  context.stroke();
}

/** The stretches in which the force is known. */
function parts(points) {
  const found = [];
  let current = null, last = -Infinity;
  for (const point of points) {
    if (Number.isNaN(point.value)) {
      current = null;
      continue;
    }
    if (!current || point.time - last > LONGEST_STEP) found.push((current = []));
    current.push(point);
    last = point.time;
  }
  return found;
}

function grid(context, width, height, low, high, x, y, now, theme) {
  context.strokeStyle = theme.line;
  context.fillStyle = theme.quiet;
  context.font = context.font.replace("12px", "11px");
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  const values = ticks(low, high, 3);
  for (const value of values) {
    context.beginPath();
    context.moveTo(LEFT, Math.round(y(value)) + 0.5);
    context.lineTo(width - RIGHT, Math.round(y(value)) + 0.5);
    context.stroke();
    context.fillText(tickText(value, values), LEFT - 5, y(value));
  }
  context.textAlign = "center";
  context.textBaseline = "top";
  for (let back = 0; back <= SPAN; back += width < 280 ? 10 : 5) {
    const text = back ? `−${back} s` : "now";
    const half = context.measureText(text).width / 2;
    context.fillText(text, Math.min(Math.max(x(now - back), LEFT + half - 8), width - half - 1), height - BOTTOM + 6);
  }
}
