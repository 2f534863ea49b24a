// Geometry of the touched surface: flat, or bent to a cylinder with the array on its outer side. Lengths in metres.

/** Centre of a taxel along the surface. */
export function taxelCentre(array, index) {
  const row = Math.floor(index / array.cols), col = index % array.cols;
  return [(col - (array.cols - 1) / 2) * array.pitch[0], (row - (array.rows - 1) / 2) * array.pitch[1]];
}

/** Point, outward normal and tangents in space of the point (x, y) of the surface. */
export function placed(array, x, y) {
  if (array.bend_radius === null) return { point: [x, y, 0], normal: [0, 0, 1], u: [1, 0, 0], v: [0, 1, 0] };
  const alongX = array.bend_axis === "x", tilt = (alongX ? y : x) / array.bend_radius;
  const sine = Math.sin(tilt), cosine = Math.cos(tilt);
  const out = array.bend_radius * sine, down = array.bend_radius * (cosine - 1);
  return alongX
    ? { point: [x, out, down], normal: [0, sine, cosine], u: [1, 0, 0], v: [0, cosine, -sine] }
    : { point: [out, y, down], normal: [sine, 0, cosine], u: [cosine, 0, -sine], v: [0, 1, 0] };
}

/** Points along the ellipse of one standard deviation of a contact's force distribution; none where it is unknown. */
export function ellipse(contact, steps = 48) {
  if ([contact.x, contact.y, ...contact.major, ...contact.minor].includes(null)) return [];
  return Array.from({ length: steps + 1 }, (_, step) => {
    const angle = (2 * Math.PI * step) / steps, c = Math.cos(angle), s = Math.sin(angle);
    return [contact.x + c * contact.major[0] + s * contact.minor[0], contact.y + c * contact.major[1] + s * contact.minor[1]];
  });
}

export const MOVING = 2e-3; // speed from which an arrow is drawn [m/s]
export const ARROW_TIME = 0.1; // an arrow is as long as the way in this time [s]

/** End of the arrow of a moving contact; null at rest. */
export function arrowEnd(contact) {
  const [x, y] = contact.velocity;
  if (x === null || y === null || Math.hypot(x, y) < MOVING || contact.state !== "moving") return null;
  return [contact.x + x * ARROW_TIME, contact.y + y * ARROW_TIME];
}
