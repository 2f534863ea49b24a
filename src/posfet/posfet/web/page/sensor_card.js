// One sensor on the page: its numbers, force map, chip, charts and diagnostics.

import { Actions } from "./actions.js";
import { contactColour, themed } from "./canvas.js";
import { Chip3d } from "./chip_3d.js";
import { ForceMap } from "./force_map.js";
import { UNKNOWN, counted, fixed, nice, signed, withDeviation } from "./numbers.js";
import { SPAN, Series, drawChart } from "./strip_chart.js";

const LEAST_SCALE = 0.2; // smallest full scale of the colours [N], so that noise stays dark
const OLD = 1000; // age of the newest scan from which on it is called old [ms]
const LEVELS = [["OK", "good"], ["warning", "warn"], ["error", "bad"]];
const MOST_NUMBERS = 1024; // taxels up to which there is a table of all

export class SensorCard {
  constructor(namespace) {
    this.namespace = namespace;
    this.element = document.getElementById("sensor").content.firstElementChild.cloneNode(true);
    this.element.setAttribute("aria-label", namespace);
    this.fields = Object.fromEntries([...this.element.querySelectorAll("[data-field]")].map((each) => [each.dataset.field, each]));
    this.actions = new Actions(this.element, namespace);
    this.map = new ForceMap(this.element.querySelector(".map"), (index) => this.choose(index));
    this.chip = new Chip3d(this.element.querySelector(".chip"));
    this.charts = Object.fromEntries([...this.element.querySelectorAll("[data-chart]")].map((each) => [each.dataset.chart, each]));
    this.element.querySelector(".map").addEventListener("keydown", (event) => this.move(event));
    this.array = this.frame = null;
    this.chosen = null;
    this.start();
  }

  /** Forgets what was drawn: another stack, or one that was started again. */
  start() {
    this.frame = null;
    this.total = new Series(() => themed().accent);
    this.contacts = new Map();
    this.taxel = new Series(() => themed().accent);
    this.peaks = [];
    this.rates = [];
  }

  setup(array, shared) {
    this.shared = shared;
    this.fields.name.textContent = this.namespace;
    this.actions.scenes(shared.scenes);
    if (!array || JSON.stringify(array) === JSON.stringify(this.array)) return;
    this.array = array;
    const bent = array.bend_radius === null ? "flat" : `bent to ${fixed(array.bend_radius * 1e3, 1)} mm`;
    this.fields.kind.textContent = `${array.name}${array.serial ? ` ${array.serial}` : ""}, ${array.cols} × ${array.rows}, ${bent}, ${array.simulated ? "simulated" : "board"}`;
    this.fields.numbers.hidden = array.rows * array.cols > MOST_NUMBERS;
    this.chosen = Math.floor(array.rows / 2) * array.cols + Math.floor(array.cols / 2);
    this.start();
    this.chip.prepare(array);
  }

  diagnoses({ nodes, actions, recording }) {
    this.actions.offer(actions, recording);
    this.fields.diagnoses.replaceChildren(
      ...nodes.map(({ name, level, text, remedies }) => {
        const [word, kind] = LEVELS[Math.min(level, 2)];
        const item = document.createElement("li");
        const line = made("span", "", "", name);
        line.append(made("span", `${name.split("_node")[0].replaceAll("_", " ")}: `, "quiet"), text);
        item.append(made("b", word, kind), line);
        for (const [fault, remedy] of Object.entries(remedies)) item.append(made("span", `${fault}: ${remedy}`, "quiet"));
        return item;
      }),
    );
  }

  /** Takes the newest frame; null before the first scan. */
  take(frame) {
    if (!frame || !this.array) return;
    if (this.frame && frame.scans < this.frame.scans) this.start();
    const again = this.frame && frame.sequence === this.frame.sequence;
    this.frame = frame;
    if (again) return;
    const time = (this.now = frame.stamp / 1e3);
    const known = frame.valid;
    this.total.add(time, known ? frame.total : null, frame.total_deviation);
    this.addTaxel();
    for (const contact of frame.contacts) {
      if (!this.contacts.has(contact.id)) this.contacts.set(contact.id, new Series(() => contactColour(contact.id)));
      this.contacts.get(contact.id).add(time, contact.force, contact.deviation);
    }
    for (const [id, series] of this.contacts) {
      series.forget(time);
      if (series.empty) this.contacts.delete(id);
    }
    this.rates = [...this.rates.filter(([at]) => at > time - 2), [time, frame.scans]];
    const peak = frame.force.reduce((most, force) => (force > most ? force : most), LEAST_SCALE);
    this.peaks = [...this.peaks.filter(([at]) => at > time - SPAN), [time, peak]];
  }

  addTaxel() {
    const force = this.frame.force[this.chosen];
    this.taxel.add(this.now, Number.isNaN(force) ? null : force, this.frame.deviation[this.chosen]);
  }

  get scale() {
    return nice(Math.max(LEAST_SCALE, ...this.peaks.map(([, peak]) => peak)));
  }

  choose(index) {
    if (index === this.chosen) return;
    this.chosen = index;
    this.taxel.clear();
    if (this.frame) this.addTaxel();
    this.draw();
  }

  move(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step || !this.array) return;
    event.preventDefault();
    const { rows, cols } = this.array;
    const col = (this.chosen % cols) + step[0], row = Math.floor(this.chosen / cols) + step[1];
    if (col >= 0 && row >= 0 && col < cols && row < rows) this.choose(row * cols + col);
  }

  draw() {
    const { frame, array, shared } = this;
    if (!frame || !array) {
      this.pill("waiting for the first scan", "warn");
      return;
    }
    this.head(frame);
    this.numbers(frame);
    const scale = this.scale;
    this.map.draw(array, frame, scale, shared.colours, shared.statuses, this.chosen);
    this.chip.draw(frame, scale, shared.colours, () => this.draw());
    drawChart(this.charts.total, [this.total], this.now);
    drawChart(this.charts.contacts, [...this.contacts.values()], this.now);
    drawChart(this.charts.taxel, [this.taxel], this.now);
  }

  head(frame) {
    const { fields } = this;
    const behind = Date.now() - frame.stamp;
    if (behind > OLD) this.pill(`no new scans for ${fixed(behind / 1e3, 0)} s`, "bad");
    else if (frame.valid) this.pill("forces valid", "good");
    else this.pill("forces unknown", "warn");
    const [[from, first], [to, last]] = [this.rates[0], this.rates.at(-1)];
    fields.rate.textContent = to > from ? `${fixed((last - first) / (to - from), 0)} scans/s` : "";
    fields.behind.textContent = behind > OLD ? "" : `${fixed(Math.max(behind, 0), 0)} ms behind`;
    const lost = frame.frames_lost || frame.scans_lost;
    fields.losses.textContent = `${counted(frame.frames_lost, "frame")} lost, ${counted(frame.scans_lost, "scan")} missing`;
    fields.losses.className = lost ? "small warn" : "quiet";
    const notice = frame.calibration.startsWith("uncalibrated") ? frame.calibration : "";
    fields.notice.textContent = notice;
    fields.notice.hidden = !notice;
  }

  numbers(frame) {
    const { fields, array } = this;
    fields.total.textContent = frame.valid && frame.total !== null ? `${fixed(frame.total, 3)} N` : UNKNOWN;
    fields["total-deviation"].textContent = frame.valid && frame.total !== null ? `± ${fixed(frame.total_deviation, 3, "?")} N` : "not for control";
    fields.contacts.classList.toggle("unsure", !frame.valid);
    fields.contacts.replaceChildren(...(frame.contacts.length ? frame.contacts.map(row) : [nothing(frame)]));
    const rows = Math.floor(this.chosen / array.cols), cols = this.chosen % array.cols;
    const force = frame.force[this.chosen];
    fields.taxel.textContent = `row ${rows}, column ${cols}: ${withDeviation(Number.isNaN(force) ? null : force, frame.deviation[this.chosen])} N`;
    fields.truth.textContent = frame.truth.length ? `ground truth ◯: ${frame.truth.map((each) => `${fixed(each.force, 2)} N`).join(", ")}` : "";
    if (fields.numbers.open && !fields.numbers.hidden) this.table(frame);
  }

  table(frame) {
    const { rows, cols } = this.array;
    const lines = Array.from({ length: rows }, (_, index) => {
      const line = document.createElement("tr");
      const first = (rows - 1 - index) * cols;
      for (let col = 0; col < cols; col += 1) line.append(made("td", fixed(frame.force[first + col], 4, "?")));
      return line;
    });
    this.fields.numbers.querySelector("table").replaceChildren(...lines);
  }

  pill(text, kind) {
    this.fields.validity.textContent = text;
    this.fields.validity.className = `pill ${kind}`;
  }
}

function row(contact) {
  const line = document.createElement("tr");
  const id = made("td", `#${contact.id}`);
  id.style.color = contactColour(contact.id);
  const force = made("td", `${fixed(contact.force, 3, "?")} `);
  force.append(made("span", `± ${fixed(contact.deviation, 3, "?")}`, "quiet"));
  const place = `${signed(contact.x && contact.x * 1e3, 2)}, ${signed(contact.y && contact.y * 1e3, 2)}`;
  line.append(id, made("td", contact.state), force, made("td", place), made("td", fixed(contact.area && contact.area * 1e6, 1)), made("td", fixed(contact.age, 1)));
  return line;
}

function nothing(frame) {
  const line = document.createElement("tr");
  const cell = made("td", frame.valid ? "no contact" : "unknown until forces are valid");
  cell.colSpan = 6;
  line.append(cell);
  return line;
}

function made(tag, text, kind = "", title = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  if (title) element.title = title;
  return element;
}
