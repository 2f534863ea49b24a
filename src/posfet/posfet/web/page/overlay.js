// Contacts and ground truth on top of a view of the array, which says where a point of the surface is on the canvas.

import { markColour } from "./canvas.js";
import { arrowEnd, ellipse } from "./surface.js";

/** Draws with `around(x, y)`, which returns what maps points near this one to canvas coordinates. */
export function drawContacts(context, frame, around, colours) {
  for (const { x, y } of frame.truth) cross(context, ...around(x, y)(x, y));
  for (const contact of frame.contacts) {
    const at = around(contact.x, contact.y);
    if (contact.x === null || contact.y === null) continue;
    const colour = markColour(contact.id);
    outlined(context, ellipse(contact).map(([x, y]) => at(x, y)), colour);
    const end = arrowEnd(contact);
    if (end) arrow(context, at(contact.x, contact.y), at(...end), colour);
    label(context, `#${contact.id}`, ...at(contact.x, contact.y), colour, colours);
  }
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

/** The mark of the ground truth: a ring with four arms. */
function cross(context, x, y) {
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
