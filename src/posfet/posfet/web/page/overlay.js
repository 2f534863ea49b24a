// Contacts and ground truth on top of a view of the array, which says where a point of the surface is on the canvas.

import { markColour } from "./canvas.js";
import { arrowEnd, ellipse } from "./surface.js";

const LABEL = 13; // distance of the middle of an id from the ellipse, and from its least radius [px]
const LEAST = 15; // [px]

/** Draws with `around(x, y)`, which returns what maps points near this one to canvas coordinates; ids by `drawIds`. */
export function drawContacts(context, frame, around) {
  for (const { x, y } of frame.truth) ring(context, ...around(x, y)(x, y));
  for (const contact of located(frame)) {
    const at = around(contact.x, contact.y);
    const colour = markColour(contact.id);
    outlined(context, ellipse(contact).map(([x, y]) => at(x, y)), colour);
    const end = arrowEnd(contact);
    if (end) arrow(context, at(contact.x, contact.y), at(...end), colour);
    dot(context, ...at(contact.x, contact.y), colour);
  }
}

/** The id of each contact beside its ellipse, so that its middle stays free: above it (side -1) or below it (1). */
export function drawIds(context, frame, around, colours, side) {
  for (const contact of located(frame)) {
    const at = around(contact.x, contact.y);
    const [x, y] = at(contact.x, contact.y);
    const heights = ellipse(contact).map((point) => at(...point)[1]);
    const above = Math.min(...heights, y - LEAST) - LABEL, below = Math.max(...heights, y + LEAST) + LABEL;
    label(context, `#${contact.id}`, x, side < 0 && above > LABEL ? above : below, markColour(contact.id), colours);
  }
}

function located({ contacts }) {
  return contacts.filter(({ x, y }) => x !== null && y !== null);
}

function outlined(context, points, colour) {
  for (const [width, style] of [[4.5, "#000a"], [2.2, colour]]) {
    context.beginPath();
    points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.lineWidth = width;
    context.strokeStyle = style;
    context.stroke();
  }
}

export function arrow(context, [x, y], [endX, endY], colour) {
  const length = Math.hypot(endX - x, endY - y);
  if (length < 2) return;
  const u = (endX - x) / length, v = (endY - y) / length, head = Math.min(9, length);
  outlined(context, [[x, y], [endX, endY]], colour);
  outlined(context, [[endX - head * (u + 0.6 * v), endY - head * (v - 0.6 * u)], [endX, endY], [endX - head * (u - 0.6 * v), endY - head * (v + 0.6 * u)]], colour);
}

function label(context, text, x, y, colour, colours) {
  context.font = `600 ${context.font.slice(context.font.indexOf("12px"))}`;
  const width = context.measureText(text).width + 10;
  context.fillStyle = colours.card;
  context.beginPath();
  context.roundRect(x - width / 2, y - 9, width, 18, 9);
  context.fill();
  context.strokeStyle = colour;
  context.lineWidth = 1.5;
  context.stroke();
  context.fillStyle = colours.text;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y + 0.5);
  context.font = context.font.replace(/^(600|bold) /, "");
}

/** A centre of pressure. */
function dot(context, x, y, colour) {
  context.beginPath();
  context.arc(x, y, 4, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.strokeStyle = "#000b";
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
}

/** The mark of the ground truth: a ring with four arms. */
function ring(context, x, y) {
  for (const [width, style] of [[4, "#000b"], [1.6, "#fff"]]) {
    context.beginPath();
    context.arc(x, y, 13, 0, 2 * Math.PI);
    for (const [u, v] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + 10 * u, y + 10 * v);
      context.lineTo(x + 18 * u, y + 18 * v);
    }
    context.lineWidth = width;
    context.strokeStyle = style;
    context.setLineDash([]);
    context.stroke();
  }
}
