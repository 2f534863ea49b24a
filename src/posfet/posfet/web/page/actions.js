// Buttons of one sensor: tare, scene, calibration, record. Only what somebody serves can be pressed.

import { call } from "./stream.js";

export class Actions {
  constructor(element, namespace) {
    this.namespace = namespace;
    this.form = element.querySelector("form");
    this.scene = element.querySelector("[data-field=scene]");
    this.file = element.querySelector("[data-field=file]");
    this.answer = element.querySelector("[data-field=answer]");
    this.form.addEventListener("submit", (event) => event.preventDefault());
    this.form.addEventListener("click", (event) => {
      const action = event.target.closest("button")?.dataset.action;
      if (action === "record") this.run(action, !this.recording);
      else if (action) this.run(action, action === "tare" ? false : this.file.value.trim());
    });
    this.scene.addEventListener("change", () => this.run("scene/load", this.scene.value));
    this.offer([], false);
  }

  scenes(names) {
    if (this.scene.options.length) return;
    this.scene.append(new Option("choose …", "", true, true), ...names.map((name) => new Option(name.replaceAll("_", " "), name)));
    this.scene.options[0].disabled = true;
  }

  offer(actions, recording) {
    this.recording = recording;
    this.form.querySelector("[data-action=record]").setAttribute("aria-pressed", String(recording));
    for (const each of this.form.querySelectorAll("[data-action]")) {
      const there = actions.includes(each.dataset.action);
      if (each.tagName === "BUTTON") each.disabled = !there;
      else each.hidden = !there;
    }
  }

  async run(action, argument) {
    this.say("…", true);
    const { success, message } = await call(this.namespace, action, argument);
    this.say(message || "done", success);
  }

  say(text, success) {
    this.answer.textContent = text;
    this.answer.className = success ? "" : "bad";
  }

  /** What a key does; returns whether it is one of these. */
  key(name) {
    if (name === "t") this.form.querySelector("[data-action=tare]").click();
    else if (name === "r") this.form.querySelector("[data-action=record]").click();
    else if (name === "s") this.scene.focus();
    else if (name === "c") this.file.select();
    else return false;
    return true;
  }
}
