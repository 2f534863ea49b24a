// The flat or bent chip in space with WebGL: a bar on each taxel, as high as its force; contacts are drawn over it.

import { fitted, markColour, themed } from "./canvas.js";
import { fixed } from "./numbers.js";
import { multiplied, perspective, turned } from "./matrices.js";
import { arrow, drawContacts, drawIds } from "./overlay.js";
import { placed, taxelCentre } from "./surface.js";

const BAR = 0.46; // half the width of a bar [pitch]
const VERTEX = `#version 300 es
const float CHIP_WIDTH = ${(0.5 / BAR + 0.005).toFixed(4)};
const vec3 CHIP_COLOUR = vec3(0.30, 0.33, 0.42);
uniform mat4 view;
uniform float chip; // 0: bars on the taxels; else the chip below them, of this thickness
in vec3 corner, shade, point, u, v, n;
in vec4 colour;
in float height;
out vec3 lit;
void main() {
  float above = chip > 0.0 ? (corner.z - 1.0) * chip : corner.z * height;
  float wide = chip > 0.0 ? CHIP_WIDTH : 1.0;
  vec3 place = point + wide * (corner.x * u + corner.y * v) + above * n;
  vec3 normal = normalize(shade.x * normalize(u) + shade.y * normalize(v) + shade.z * n);
  float light = 0.62 + 0.38 * max(dot(normal, normalize(vec3(0.35, -0.5, 0.8))), 0.0);
  lit = (chip > 0.0 ? CHIP_COLOUR : colour.rgb) * light;
  gl_Position = view * vec4(place, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 lit;
out vec4 shown;
void main() { shown = vec4(lit, 1.0); }`;
const FULL = 0.34; // height of a bar at full scale [size of the array]
const CHIP = 0.035; // thickness of the chip [size of the array]
const START = { yaw: -0.55, pitch: 0.95, zoom: 1 };

/** Corners and normals of a box from z = 0 to 1 without its bottom, two triangles a side. */
function box() {
  const corners = [], shades = [];
  const side = (quad, shade) => {
    for (const index of [0, 1, 2, 0, 2, 3]) {
      corners.push(...quad[index]);
      shades.push(...shade);
    }
  };
  side([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], [0, 0, 1]);
  for (const [a, b, shade] of [[[-1, -1], [1, -1], [0, -1, 0]], [[1, -1], [1, 1], [1, 0, 0]], [[1, 1], [-1, 1], [0, 1, 0]], [[-1, 1], [-1, -1], [-1, 0, 0]]]) {
    side([[...a, 0], [...b, 0], [...b, 1], [...a, 1]], shade);
  }
  return { corners: new Float32Array(corners), shades: new Float32Array(shades), count: corners.length / 3 };
}

export class Chip3d {
  constructor(place) {
    [this.solid, this.over] = place.querySelectorAll("canvas");
    this.camera = { ...START };
    this.gl = this.solid.getContext("webgl2", { antialias: true });
    this.array = null;
    this.solid.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.solid.addEventListener("webglcontextrestored", () => this.prepare(this.array));
    this.redraw = () => {};
    this.control(place);
  }

  control(place) {
    place.addEventListener("pointerdown", (event) => place.setPointerCapture(event.pointerId));
    place.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.turn(event.movementX * 0.008, event.movementY * 0.008);
    });
    place.addEventListener("dblclick", () => this.reset());
    place.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (turn) this.turn(...turn);
      else if (event.key === "+" || event.key === "-") this.zoom(event.key === "+" ? 1.1 : 1 / 1.1);
      else if (event.key === "0") this.reset();
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  turn(yaw, pitch) {
    this.camera.yaw += yaw;
    this.camera.pitch = Math.min(Math.max(this.camera.pitch + pitch, 0), 1.5);
    this.redraw();
  }

  zoom(factor) {
    this.camera.zoom = Math.min(Math.max(this.camera.zoom * factor, 0.4), 3);
    this.redraw();
  }

  reset() {
    this.camera = { ...START };
    this.redraw();
  }

  /** Uploads what does not change: where each taxel is. */
  prepare(array) {
    this.array = array;
    if (!array) return;
    this.size = Math.max(array.cols * array.pitch[0], array.rows * array.pitch[1]);
    const { point } = placed(array, (array.cols / 2) * array.pitch[0], (array.rows / 2) * array.pitch[1]);
    this.lift = -0.02 - (0.5 * point[2]) / this.size; // the middle of bars and arrows in the middle of the picture
    const { gl } = this;
    if (!gl) return;
    this.program = linked(gl);
    gl.bindVertexArray(gl.createVertexArray());
    const { corners, shades, count } = box();
    this.vertices = count;
    attribute(gl, this.program, [["corner", 3]], corners, 0);
    attribute(gl, this.program, [["shade", 3]], shades, 0);
    const places = [];
    for (let index = 0; index < array.rows * array.cols; index += 1) {
      const { point, normal, u, v } = placed(array, ...taxelCentre(array, index));
      const half = [array.pitch[0] * BAR, array.pitch[1] * BAR];
      places.push(...point, ...u.map((each) => each * half[0]), ...v.map((each) => each * half[1]), ...normal);
    }
    attribute(gl, this.program, [["point", 3], ["u", 3], ["v", 3], ["n", 3]], new Float32Array(places), 1);
    this.bars = new Float32Array(array.rows * array.cols * 5);
    this.buffer = attribute(gl, this.program, [["colour", 4], ["height", 1]], this.bars, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
  }

  draw(frame, scale, colours, redraw) {
    this.redraw = redraw;
    const { context, width, height } = fitted(this.over);
    const theme = themed();
    const view = this.view(width / height);
    if (this.gl) this.drawBars(frame, scale, colours, theme, view, width, height);
    else {
      context.fillStyle = theme.quiet;
      context.fillText("this browser has no WebGL 2: the chip is not drawn in space", 10, 20);
    }
    const at = (point) => onCanvas(view, point, width, height);
    /** Points at the height of the bar at (x, y). */
    const around = (x, y) => {
      const height = this.barHeight(this.forceAt(frame, x, y), scale);
      return (u, v) => {
        const { point, normal } = placed(this.array, u, v);
        return at(point.map((each, i) => each + normal[i] * height));
      };
    };
    this.axes(context, at, theme);
    drawContacts(context, frame, around);
    for (const contact of frame.contacts) this.push(context, contact, around, at, scale, theme);
    drawIds(context, frame, around, theme, 1);
  }

  /** The force of a contact on the chip: an arrow along the normal, with its standard deviation. */
  push(context, contact, around, at, scale, theme) {
    if (contact.force === null || contact.x === null) return;
    const { point, normal } = placed(this.array, contact.x, contact.y);
    const base = around(contact.x, contact.y)(contact.x, contact.y);
    const tip = [base[0], base[1] - 12];
    const length = this.size * (0.12 + 0.1 * Math.min(contact.force / scale, 3));
    const far = at(point.map((each, i) => each + normal[i] * length)), near = at(point);
    const start = [tip[0] + far[0] - near[0], tip[1] + far[1] - near[1]];
    arrow(context, start, tip, markColour(contact.id));
    context.textAlign = "center";
    context.textBaseline = "bottom";
    context.lineWidth = 4;
    context.strokeStyle = theme.card;
    context.fillStyle = theme.text;
    const text = `${fixed(contact.force, 2)} ± ${fixed(contact.deviation, 2, "?")} N`;
    const y = Math.max(start[1] - 4, 16);
    context.strokeText(text, start[0], y);
    context.fillText(text, start[0], y);
  }

  forceAt(frame, x, y) {
    const { array } = this;
    const col = Math.min(Math.max(Math.round(x / array.pitch[0] + (array.cols - 1) / 2), 0), array.cols - 1);
    const row = Math.min(Math.max(Math.round(y / array.pitch[1] + (array.rows - 1) / 2), 0), array.rows - 1);
    return frame.force[row * array.cols + col];
  }

  barHeight(force, scale) {
    return this.size * (0.02 + (Number.isNaN(force) ? 0 : Math.min(Math.max(force / scale, 0), 1) * FULL));
  }

  drawBars(frame, scale, colours, theme, view, width, height) {
    const { gl, bars } = this;
    const ratio = window.devicePixelRatio || 1;
    if (this.solid.width !== Math.round(width * ratio) || this.solid.height !== Math.round(height * ratio)) {
      this.solid.width = Math.round(width * ratio);
      this.solid.height = Math.round(height * ratio);
    }
    const unknown = components(theme.unknown);
    for (let index = 0; index < frame.force.length; index += 1) {
      const force = frame.force[index], missing = Number.isNaN(force);
      const level = missing ? 0 : Math.min(Math.max(force / scale, 0), 1);
      bars.set(missing ? unknown : hexComponents(colours[Math.round(level * (colours.length - 1))]), index * 5);
      bars[index * 5 + 4] = this.barHeight(force, scale);
    }
    gl.viewport(0, 0, this.solid.width, this.solid.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, bars);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "view"), false, view);
    for (const thickness of [CHIP * this.size, 0]) {
      gl.uniform1f(gl.getUniformLocation(this.program, "chip"), thickness);
      gl.drawArraysInstanced(gl.TRIANGLES, 0, this.vertices, frame.force.length);
    }
  }

  view(aspect) {
    const { yaw, pitch, zoom } = this.camera;
    const distance = (2.35 / zoom) * Math.max(1, 1.05 / aspect);
    return multiplied(perspective(0.62, aspect, 0.05, 20), turned(yaw, pitch, distance, 1 / this.size, this.lift));
  }

  /** The edge of the chip, and x and y beside it. */
  axes(context, at, theme) {
    const { array } = this;
    const [right, high] = [(array.cols / 2) * array.pitch[0], (array.rows / 2) * array.pitch[1]];
    const corner = (u, v) => at(placed(array, u * right, v * high).point);
    context.beginPath();
    for (let step = -8; step <= 8; step += 1) context.lineTo(...corner(step / 8, -1));
    for (let step = -8; step <= 8; step += 1) context.lineTo(...corner(1, step / 8));
    context.strokeStyle = theme.quiet;
    context.lineWidth = 1.2;
    context.stroke();
    const x = (array.cols / 2 + 0.35) * array.pitch[0], y = (array.rows / 2 + 0.35) * array.pitch[1];
    context.fillStyle = theme.quiet;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText("x", ...at(placed(array, x, 0).point));
    context.fillText("y", ...at(placed(array, 0, y).point));
  }
}

function onCanvas(view, [x, y, z], width, height) {
  const w = view[3] * x + view[7] * y + view[11] * z + view[15];
  return [
    ((view[0] * x + view[4] * y + view[8] * z + view[12]) / w + 1) * 0.5 * width,
    (1 - (view[1] * x + view[5] * y + view[9] * z + view[13]) / w) * 0.5 * height,
  ];
}

function hexComponents(text) {
  const value = Number.parseInt(text.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255, 1];
}

function components(rgb) {
  return [...rgb.match(/[\d.]+/g).slice(0, 3).map((each) => Number(each) / 255), 1];
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

/** A buffer with interleaved attributes, one for each vertex (divisor 0) or for each taxel (1). */
function attribute(gl, program, parts, data, divisor) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  const stride = parts.reduce((sum, [, count]) => sum + count, 0) * 4;
  let offset = 0;
  for (const [name, count] of parts) {
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, count, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(place, divisor);
    offset += count * 4;
  }
  return buffer;
}
