// The force map: one cell for each taxel, axes in mm, colour scale in newtons.

import { fitted, hatch, themed } from "./canvas.js";
import { fixed, tickText, ticks } from "./numbers.js";
import { drawContacts, drawIds } from "./overlay.js";

const LEFT = 40, BOTTOM = 36, TOP = 6, RIGHT = 66, BAR = 14, GAP = 14;
const LEAST_FOR_NUMBERS = 38; // width of a cell from which on it has its number [px]

export class ForceMap {
  constructor(canvas, choose) {
    this.canvas = canvas;
    this.cell = null;
    canvas.addEventListener("click", (event) => {
      const found = this.taxelAt(event.offsetX, event.offsetY);
      if (found !== null) choose(found);
    });
  }

  /** Index of the taxel at a place of the canvas; null beside the array. */
  taxelAt(x, y) {
    if (!this.cell) return null;
    const { left, bottom, size, array } = this.cell;
    const col = Math.floor((x - left) / size[0]), row = Math.floor((bottom - y) / size[1]);
    return col >= 0 && row >= 0 && col < array.cols && row < array.rows ? row * array.cols + col : null;
  }

  draw(array, frame, scale, colours, statuses, chosen) {
    const { context, width, height } = fitted(this.canvas);
    const theme = themed();
    const wide = array.cols * array.pitch[0], high = array.rows * array.pitch[1];
    const pixels = Math.min((width - LEFT - RIGHT) / wide, (height - TOP - BOTTOM) / high);
    const left = LEFT + (width - LEFT - RIGHT - wide * pixels) / 2;
    const bottom = TOP + (height - TOP - BOTTOM + high * pixels) / 2;
    const size = [array.pitch[0] * pixels, array.pitch[1] * pixels];
    this.cell = { left, bottom, size, array };
    const at = (x, y) => [left + (x + wide / 2) * pixels, bottom - (y + high / 2) * pixels];
    const gap = Math.min(2, size[0] * 0.06);
    context.textAlign = "center";
    context.textBaseline = "middle";
    const texts = [];
    for (let index = 0; index < frame.force.length; index += 1) {
      const x = left + (index % array.cols) * size[0] + gap / 2, y = bottom - (Math.floor(index / array.cols) + 1) * size[1] + gap / 2;
      const text = this.taxel(context, x, y, size[0] - gap, size[1] - gap, frame, index, scale, colours, statuses, theme);
      if (text) texts.push(text);
    }
    if (chosen !== null) {
      const corner = [left + (chosen % array.cols) * size[0], bottom - (Math.floor(chosen / array.cols) + 1) * size[1]];
      for (const [lineWidth, strokeStyle] of [[5, "#000"], [2.5, "#fff"]]) {
        Object.assign(context, { lineWidth, strokeStyle });
        context.strokeRect(...corner, ...size);
      }
    }
    drawContacts(context, frame, () => at);
    for (const [text, ...place] of texts) number(context, text, ...place);
    drawIds(context, frame, () => at, theme, -1);
    this.axes(context, at, wide, high, left, bottom, theme);
    this.colourBar(context, left + wide * pixels + GAP, bottom - high * pixels, high * pixels, scale, colours, theme);
  }

  /** Fills a cell and returns its number with what `number` takes; null where there is none. */
  taxel(context, x, y, width, height, frame, index, scale, colours, statuses, theme) {
    const force = frame.force[index], status = statuses[frame.status[index]];
    const numbers = width >= LEAST_FOR_NUMBERS && height >= 20;
    if (Number.isNaN(force)) {
      hatch(context, x, y, width, height, theme);
      if (!numbers) return null;
      context.fillStyle = theme.text;
      context.fillText(status === "ok" ? "?" : status, x + width / 2, y + height / 2, width - 4);
      return null;
    }
    const level = Math.min(Math.max(force / scale, 0), 1);
    context.fillStyle = colours[Math.round(level * (colours.length - 1))];
    context.fillRect(x, y, width, height);
    if (!numbers) return null;
    const text = (status === "saturated" ? "≥ " : "") + fixed(force, width > 50 ? 3 : 2).replace("-", "−");
    const ink = level > 0.55 ? "#000c" : level < 0.02 ? "#fff9" : "#fffd";
    return [text, x + width / 2, y + height - 11, width - 4, ink, context.fillStyle];
  }

  axes(context, at, wide, high, left, bottom, theme) {
    context.fillStyle = theme.quiet;
    context.strokeStyle = theme.quiet;
    context.lineWidth = 1;
    const values = ticks(-wide * 500, wide * 500, 4), upward = ticks(-high * 500, high * 500, 4);
    context.textBaseline = "top";
    for (const value of values) {
      const [x] = at(value * 1e-3, 0);
      line(context, x, bottom + 2, x, bottom + 6);
      context.fillText(tickText(value, values), x, bottom + 9);
    }
    context.fillText("x [mm]", at(0, 0)[0] + 34, bottom + 22);
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of upward) {
      const [, y] = at(0, value * 1e-3);
      line(context, left - 6, y, left - 2, y);
      context.fillText(tickText(value, upward), left - 9, y);
    }
    context.save();
    context.translate(left - 33, at(0, 0)[1]);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText("y [mm]", 0, 0);
    context.restore();
  }

  colourBar(context, x, top, height, scale, colours, theme) {
    const gradient = context.createLinearGradient(0, top + height, 0, top);
    for (let step = 0; step <= 16; step += 1) gradient.addColorStop(step / 16, colours[Math.round((step / 16) * (colours.length - 1))]);
    context.fillStyle = gradient;
    context.fillRect(x, top, BAR, height);
    context.fillStyle = theme.quiet;
    context.textAlign = "left";
    context.textBaseline = "middle";
    const values = ticks(0, scale, 5);
    for (const value of values) {
      const y = top + height * (1 - value / scale);
      line(context, x + BAR, y, x + BAR + 4, y);
      context.fillText(tickText(value, values), x + BAR + 7, Math.min(Math.max(y, top + 5), top + height - 5));
    }
    context.fillText("N", x + BAR + 7, top + height + 14);
  }
}

/** A number in the colour `ink`, on a rim in the colour of its cell, so that it is legible over the marks of contacts. */
function number(context, text, x, y, most, ink, cell) {
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.lineWidth = 3.5;
  context.strokeStyle = cell;
  context.strokeText(text, x, y, most);
  context.fillStyle = ink;
  context.fillText(text, x, y, most);
}

function line(context, x, y, endX, endY) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(endX, endY);
  context.stroke();
}
