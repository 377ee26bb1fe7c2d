// Buttons, keys and dialogs: the commands of an operator, and their results.

import { forgetColours } from "./canvas.js";
import { duration, grams, inGrams, roughly } from "./numbers.js";

const NOTICE_MS = 4000;

const $ = (id) => document.getElementById(id);
const set = (id, text) => {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
};
const say = (button, text) => {
  const line = button.querySelector("small");
  if (line.textContent !== text) line.textContent = text;
};

export class Controls {
  #app;
  #confirmN = null; // newtons that a confirmation would subtract
  #recordingSince = null;
  #noticeTimer = null;

  /** @param app {connection, alarm, sound, state, update, verdict, view}: state of the page; read at each use */
  constructor(app) {
    this.#app = app;
    const does = {
      zero: () => this.#zero(null),
      "undo-zero": () => app.update?.values.zero && this.#ask({ command: "undo_zero" }),
      integrate: () => this.#ask({ command: "integral", on: !app.update?.values.integral_running }),
      record: () => app.state.can_record && this.#ask({ command: "record", on: !app.state.recording }),
      tone: () => (app.sound.follows = !app.sound.follows),
      pause: () => app.alarm.togglePause(performance.now()),
      "set-limits": () => this.#openLimits(),
      "switch-view": () => this.#nextView(),
      more: () => $("help").showModal(),
      theme: () => this.#theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
      full: () => this.#fullScreen(),
    };
    for (const [id, action] of Object.entries(does)) $(id).addEventListener("click", action);
    const keys = { z: "zero", u: "undo-zero", i: "integrate", r: "record", s: "tone", a: "pause", l: "set-limits", v: "switch-view" };
    Object.assign(keys, { t: "theme", f: "full", "?": "more", h: "more" });
    addEventListener("keydown", (event) => {
      const id = keys[event.key.toLowerCase()];
      const typing = event.target instanceof HTMLInputElement || document.querySelector("dialog[open]:not(#help)");
      if (!id || typing || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      does[id]();
    });
    for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, () => app.sound.unlock());
    $("confirm-zero").addEventListener("close", () => {
      if ($("confirm-zero").returnValue === "zero") this.#zero(this.#confirmN);
      $("confirm-zero").returnValue = "";
    });
    this.#limitsDialog();
    const theme = readSetting("theme");
    if (theme) this.#theme(theme);
  }

  /** Updates the texts of the buttons; called ten times a second. */
  refresh(nowMs) {
    const { alarm, sound, state, update } = this.#app;
    const values = update?.values;
    this.#refreshZero(values?.zero ?? null);
    const running = Boolean(values?.integral_running);
    press($("integrate"), running);
    say($("integrate"), running ? `running ${duration(values.clinical?.elapsed_s ?? 0)}` : "stopped");
    this.#refreshRecord(state, nowMs);
    press($("tone"), sound.follows);
    say($("tone"), sound.follows ? "follows the force" : "off");
    const paused = alarm.pausedFor(nowMs);
    press($("pause"), paused > 0);
    $("pause").classList.toggle("warn", !sound.unlocked || paused > 0);
    const calm = sound.unlocked ? "sound on" : "touch to hear it";
    say($("pause"), paused ? `sound paused ${duration(paused / 1000)}` : alarm.held ? "held: not known" : calm);
    const { window_n: window, limit_n: limit } = state.contact;
    const [low, high, most] = [...window, limit].map((value) => grams(value).toFixed(0));
    say($("set-limits"), `${low}–${high}, alarm ${most} g`);
    const lost = !this.#app.connection.open || Boolean(state.starting); // nothing would execute a command
    for (const id of ["zero", "undo-zero", "integrate"]) $(id).disabled = lost;
    $("record").disabled = lost || !state.can_record;
    $("set-limits").disabled = lost || !state.can_set_limits;
    const views = values?.views ?? [];
    $("switch-view").hidden = views.length < 2;
    if (views.length > 1) say($("switch-view"), values.view || "all");
  }

  #refreshZero(zero) {
    $("undo-zero").hidden = $("zeroed").hidden = !zero;
    say($("zero"), zero ? `${roughly(zero.age_s)} ago` : "not zeroed");
    $("zero").classList.toggle("warn", Boolean(zero?.confirmed));
    $("zeroed").classList.toggle("warn", Boolean(zero?.confirmed));
    if (!zero) return;
    const amount = `${inGrams(zero.magnitude_n)} g`;
    say($("undo-zero"), `adds ${amount} again`);
    const at = zero.since_unix_s === null ? "" : ` at ${new Date(1000 * zero.since_unix_s).toLocaleTimeString([], { hour12: false })}`;
    const parts = [`subtracted${at}${zero.by ? ` by ${zero.by}` : ""}`];
    if (zero.confirmed) parts.push("pressed in possible contact");
    if (zero.drift_n !== null) parts.push(`drift since ${inGrams(zero.drift_n)} g`);
    set("zeroed-amount", `ZERO ${amount}`);
    set("zeroed-about", parts.join(" · "));
  }

  #refreshRecord(state, nowMs) {
    this.#recordingSince = state.recording ? (this.#recordingSince ?? nowMs) : null;
    const button = $("record");
    press(button, state.recording);
    button.classList.toggle("warn", Boolean(state.recording_message));
    const idle = state.can_record ? "off" : "not in this run";
    const time = state.recording ? duration((nowMs - this.#recordingSince) / 1000) : "";
    say(button, state.recording ? `recording ${time}` : state.recording_message ? "stopped, see above" : idle);
    $("recording").hidden = !state.recording;
    $("recording").textContent = `● REC ${time}`;
  }

  notice(text) {
    $("notice").textContent = text;
    $("notice").hidden = false;
    clearTimeout(this.#noticeTimer);
    this.#noticeTimer = setTimeout(() => ($("notice").hidden = true), NOTICE_MS);
  }

  async #ask(values) {
    const answer = await this.#app.connection.ask(values);
    if (!answer.ok) this.notice(`${values.command}: ${answer.message}`);
    return answer;
  }

  /** @param {number|null} confirmedN newtons that may be subtracted although the tip may be in contact */
  async #zero(confirmedN) {
    const answer = await this.#app.connection.ask({ command: "zero", confirmed_n: confirmedN });
    if (answer.ok) return;
    if (answer.confirm_n === undefined) {
      this.notice(`zero: ${answer.message}`);
      return;
    }
    const dialog = $("confirm-zero");
    this.#confirmN = answer.confirm_n;
    dialog.querySelector(".text").textContent = `${answer.message}.`;
    dialog.querySelector("[value=zero]").textContent = `Subtract ${inGrams(answer.confirm_n)} g`;
    if (!dialog.open) dialog.showModal();
  }

  #nextView() {
    const views = this.#app.update?.values.views ?? [];
    const shown = ["", ...views]; // "": all views side by side
    if (views.length > 1) this.#app.view = shown[(shown.indexOf(this.#app.update.values.view) + 1) % shown.length];
  }

  #theme(name) {
    document.documentElement.dataset.theme = name;
    forgetColours();
    writeSetting("theme", name);
  }

  #fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch((error) => this.notice(error.message));
  }

  #openLimits() {
    const { state } = this.#app;
    if (!state.can_set_limits) return;
    const { window_n: window, limit_n: limit } = state.contact;
    $("window-low").value = window[0];
    $("window-high").value = window[1];
    $("limit").value = limit;
    $("limits").querySelector(".error").textContent = "";
    for (const input of $("limits").querySelectorAll("input")) input.dispatchEvent(new Event("input"));
    $("limits").showModal();
    $("window-low").select();
  }

  #limitsDialog() {
    const dialog = $("limits");
    const number = (id) => Number($(id).value.replace(",", "."));
    for (const input of dialog.querySelectorAll("input")) {
      input.addEventListener("input", () => {
        const value = number(input.id);
        const output = input.nextElementSibling.querySelector(".in-grams");
        output.textContent = Number.isFinite(value) ? `= ${inGrams(value)} g` : "";
      });
    }
    dialog.querySelector("[value=cancel]").addEventListener("click", () => dialog.close());
    dialog.querySelector("form").addEventListener("submit", async (event) => {
      event.preventDefault();
      const wanted = [number("window-low"), number("window-high"), number("limit")];
      const error = dialog.querySelector(".error");
      if (!wanted.every((value) => Number.isFinite(value) && value > 0)) {
        error.textContent = "enter three numbers above 0, in newtons";
        return;
      }
      const answer = await this.#app.connection.ask({
        command: "limits",
        window_n: wanted.slice(0, 2),
        limit_n: wanted[2],
      });
      if (answer.ok) dialog.close();
      else error.textContent = answer.message;
    });
  }
}

function press(button, on) {
  button.setAttribute("aria-pressed", String(on));
}

// A browser may forbid storage: the page works without it.
function readSetting(name) {
  try {
    return localStorage.getItem(`tipforce-${name}`);
  } catch {
    return null;
  }
}

function writeSetting(name, value) {
  try {
    localStorage.setItem(`tipforce-${name}`, value);
  } catch (error) {
    console.info("settings are not kept:", error.message);
  }
}
