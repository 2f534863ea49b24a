// Canvases at the resolution of the screen, and the colours of the style sheet.

/** Fits the canvas to its place; returns its context in CSS pixels with width and height. */
export function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = `12px ${getComputedStyle(document.documentElement).fontFamily}`;
  return { context, width, height };
}

let palette = null;

/** Colours of the theme by the name of their variable; read once until `forgetPalette`. */
export function themed() {
  if (palette) return palette;
  const probe = document.createElement("i");
  document.body.append(probe);
  palette = {};
  for (const name of ["page", "card", "line", "text", "quiet", "accent", "bad", "unknown"]) {
    probe.style.color = `var(--${name})`;
    palette[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  return palette;
}

export function forgetPalette() {
  palette = null;
}

const BRIGHT = ["#56b4e9", "#ff9f43", "#2bd4a4", "#ea9fcb", "#f0e442"];
const DEEP = ["#0072b2", "#d55e00", "#007a5a", "#a8467f", "#8a6d00"];

/** Colour of a contact on the force map, whose low end is dark in both themes. Told apart by colour-blind eyes. */
export function markColour(id) {
  return BRIGHT[(id - 1) % BRIGHT.length];
}

/** The same on the page. */
export function contactColour(id) {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const theme = document.documentElement.dataset.theme;
  const light = theme ? theme === "light" : !dark;
  return light ? DEEP[(id - 1) % DEEP.length] : markColour(id);
}

/** A hatched rectangle: unknown. */
export function hatch(context, x, y, width, height, colours) {
  context.save();
  context.beginPath();
  context.rect(x, y, width, height);
  context.clip();
  context.fillStyle = colours.unknown;
  context.fillRect(x, y, width, height);
  context.strokeStyle = colours.card;
  context.lineWidth = 1.5;
  context.beginPath();
  for (let offset = -height; offset < width; offset += 7) {
    context.moveTo(x + offset, y + height);
    context.lineTo(x + offset + height, y);
  }
  context.stroke();
  context.restore();
}
