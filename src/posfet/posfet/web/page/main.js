// The page: takes the stream, draws the newest frame, and gives keys to the chosen sensor.

import { forgetPalette } from "./canvas.js";
import { SensorCard } from "./sensor_card.js";
import { listen } from "./stream.js";

const main = document.getElementById("sensors");
const connection = document.getElementById("connection");
const pause = document.getElementById("pause");
const cards = new Map();
let order = [], chosen = 0, paused = false, drawing = false;

function draw() {
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    for (const card of order) card.draw();
  });
}

function choose(index) {
  if (!order[index]) return;
  chosen = index;
  order.forEach((card, each) => card.element.classList.toggle("chosen", each === index));
}

function setup(shared) {
  order = shared.sensors.map(({ namespace, array }) => {
    if (!cards.has(namespace)) {
      const card = new SensorCard(namespace);
      cards.set(namespace, card);
      main.append(card.element);
      card.element.addEventListener("focusin", () => choose(order.indexOf(card)));
      card.element.addEventListener("pointerdown", () => choose(order.indexOf(card)));
    }
    cards.get(namespace).setup(array, shared);
    return cards.get(namespace);
  });
  main.classList.toggle("several", order.length > 1);
  document.title = `${order.map((card) => card.namespace).join(", ")} · posfet`;
  choose(Math.min(chosen, order.length - 1));
  draw();
}

function setPaused(wanted) {
  paused = wanted;
  pause.setAttribute("aria-pressed", String(paused));
  for (const card of order) card.element.classList.toggle("paused", paused);
  show();
}

let connected = false, trouble = "connecting";
function show() {
  const [text, kind] = !connected ? [trouble, "bad"] : paused ? ["paused", "warn"] : ["live", "good"];
  connection.textContent = text;
  connection.className = `pill ${kind}`;
}

function switchTheme() {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  localStorage.setItem("theme", root.dataset.theme);
  forgetPalette();
  draw();
}

listen({
  connection: (up, reason = "reconnecting") => {
    connected = up;
    trouble = reason;
    show();
  },
  setup,
  diagnostics: (all) => all.forEach((each, index) => order[index]?.diagnoses(each)),
  frame: (frames) => {
    if (paused) return;
    frames.forEach((frame, index) => order[index]?.take(frame));
    draw();
  },
});

const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (forgetPalette(), draw()));
window.addEventListener("resize", draw);
pause.addEventListener("click", () => setPaused(!paused));
document.getElementById("theme").addEventListener("click", switchTheme);
document.getElementById("help").addEventListener("click", () => document.getElementById("keys").showModal());

document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") document.activeElement.blur();
  const typing = event.target.matches("input, select, textarea, dialog *");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === " " && !event.target.matches("button, summary")) setPaused(!paused);
  else if (event.key === "d") switchTheme();
  else if (event.key === "?") document.getElementById("keys").showModal();
  else if (/^[1-9]$/.test(event.key)) order[event.key - 1]?.element.focus();
  else if (!order[chosen]?.actions.key(event.key)) return;
  event.preventDefault();
});
