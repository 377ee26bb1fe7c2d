// The loop that holds a force: its state, and the operator's commands. Shown only if the program has drives.

import { inGrams, inNewtons, NOTHING } from "./numbers.js";

const CONFIRM_MS = 3000; // start is pressed a second time within this: something will move
const UNHEARD_MS = 2500; // the state comes at least twice a second; an older state is shown as not known
const FORCE_MS = 1000; // a force is shown for this time after it arrived
const ANSWER_MS = 1000; // a stop that is not answered within this time is shown as not confirmed

const WORDS = {
  idle: ["○", "IDLE"],
  waiting: ["…", "WAITING"],
  approach: ["→", "APPROACH"],
  contact: ["◔", "CONTACT"],
  hold: ["◐", "HOLD"],
  held: ["●", "HELD"],
  retract: ["←", "RETRACT"],
  stopped: ["■", "STOPPED"],
};
const UNITS = { mm: [1, " mm"], deg: [0, "°"] }; // digits, and what follows them
const ACTIONS = {
  over_limit: "above the limit, or will be in a moment: drawn back",
  coast: "no valid force for a moment: continues with the last force",
};

const $ = (id) => document.getElementById(id);
const set = (id, text) => {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
};

export class LoopPanel {
  #app;
  #status = null;
  #heardAt = -Infinity;
  #confirmUntil = -Infinity;
  #notice;

  /** @param app state of the page; @param {(text: string) => void} notice tells the operator */
  constructor(app, notice) {
    this.#app = app;
    this.#notice = notice;
    const does = {
      "mark-start": () => this.#ask("mark_start"),
      "mark-goal": () => this.#ask("mark_goal"),
      "loop-begin": () => this.#begin(),
      "loop-retract": () => this.#ask("retract"),
      "loop-release": () => this.#ask("release"),
    };
    for (const [id, action] of Object.entries(does)) $(id).addEventListener("click", action);
    for (const button of document.querySelectorAll(".stop")) { // an open dialog has one of its own: it covers the page
      button.addEventListener("pointerdown", () => this.stop()); // at the touch, not when it ends
      button.addEventListener("click", (event) => event.detail === 0 && this.stop()); // by Enter
    }
    // Before anybody else, wherever the focus is: a button, a number, a dialog.
    addEventListener("keydown", (event) => this.#key(event), { capture: true });
    addEventListener("keyup", (event) => this.#stops(event) && event.preventDefault(), { capture: true });
  }

  /** Takes the newest state of the loop. */
  heard(status) {
    this.#status = status;
    this.#heardAt = performance.now();
    this.refresh(this.#heardAt);
  }

  /** A dialog keeps its keys as long as nothing can move. */
  #stops(event) {
    if (!this.#app.state.can_hold || (event.key !== "Escape" && event.key !== " ")) return false;
    const mayMove = !this.#known() || this.#status.moves;
    return mayMove || !document.querySelector("dialog[open]");
  }

  #key(event) {
    if (!this.#stops(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.stop();
  }

  #known() {
    return this.#status !== null && this.#app.connection.open && performance.now() - this.#heardAt < UNHEARD_MS;
  }

  async stop() {
    this.#confirmUntil = -Infinity;
    const late = new Promise((done) => setTimeout(done, ANSWER_MS, { ok: false, message: "no answer yet" }));
    const answer = await Promise.race([this.#app.connection.ask({ command: "loop", do: "stop" }), late]);
    if (!answer.ok) this.#notice(`STOP is not confirmed: ${answer.message}. Use the switch of the stage.`);
  }

  async #ask(what) {
    this.#confirmUntil = -Infinity;
    const answer = await this.#app.connection.ask({ command: "loop", do: what });
    if (!answer.ok) this.#notice(`${what.replace("_", " ")}: ${answer.message}`);
  }

  #begin() {
    const now = performance.now();
    if (now < this.#confirmUntil) this.#ask("start");
    else this.#confirmUntil = now + CONFIRM_MS;
    this.refresh(now);
  }

  refresh(nowMs) {
    const there = Boolean(this.#app.state.can_hold);
    if ($("loop").hidden === there) {
      $("loop").hidden = !there;
      document.body.classList.toggle("with-loop", there);
    }
    if (!there || !this.#status) return;
    const status = this.#status;
    const known = this.#known();
    const held = known && status.state === "hold" && status.held;
    const state = held ? "held" : status.resumes ? "waiting" : status.state;
    const [sign, word] = known ? WORDS[state] : ["✕", "NOT KNOWN"];
    $("loop").dataset.held = held;
    $("loop").dataset.state = known ? status.state : "unknown";
    $("loop").dataset.action = known ? status.action : "";
    set("loop-sign", sign);
    set("loop-word", word);
    const again = status.resumes ? "begins again by itself; " : "";
    const why = known ? `${again}${ACTIONS[status.action] ?? status.reason}` : "the state of the loop is not known; STOP is sent nevertheless";
    set("loop-reason", why);
    $("loop-reason").title = why;
    this.#showNumbers(status, known && nowMs - this.#heardAt < FORCE_MS);
    this.#showPath(status);
    this.#refreshButtons(status, known, nowMs);
  }

  #showNumbers(status, known) {
    const force = known ? status.force_n : null;
    const wanted = known ? status.wanted_n : null;
    set("loop-force", force === null ? NOTHING : `${inGrams(force)} g`);
    set("loop-force-n", force === null ? "not valid" : `${inNewtons(force)} N`);
    set("loop-wanted", wanted === null ? NOTHING : `${inGrams(wanted)} g`);
    set("loop-wanted-n", wanted === null ? "" : `${inNewtons(wanted)} N`);
    this.#showDifference(status, force, wanted);
    set("loop-target", `${inGrams(status.target_n)} g`);
    set("loop-limit", `limit ${inGrams(status.limit_n)} g`);
    this.#showPeak(status);
  }

  /** Shows the largest force of the newest run and its time above the limit; then the true ones of a simulated bench. */
  #showPeak(status) {
    const peak = (force, above) => `peak ${inGrams(force)} g, ${above.toFixed(1)} s above the limit`;
    const estimated = status.peak_n === null ? NOTHING : peak(status.peak_n, status.above_limit_s);
    set("loop-peak", estimated);
    set("loop-true-peak", status.true_peak_n === null ? "" : `true force: ${peak(status.true_peak_n, status.true_above_limit_s)}`);
  }

  /** Shows the difference from the wanted force; it is marked if the 90 % interval does not contain the wanted force. */
  #showDifference(status, force, wanted) {
    const known = force !== null && wanted !== null;
    const difference = known ? force - wanted : null;
    set("loop-off", known ? `${inGrams(difference, true)} g` : NOTHING);
    const judged = known && status.upper_n !== null; // without an interval the difference is not judged
    const far = judged && Math.abs(difference) > status.upper_n - force;
    set("loop-off-note", judged ? (far ? (difference > 0 ? "too much" : "too little") : "within 90 %") : "");
    $("loop-difference").classList.toggle("warn", far);
  }

  #showPath(status) {
    const share = status.place_mm === null ? null : status.place_mm / status.length_mm;
    $("loop-place").hidden = share === null;
    if (share !== null) $("loop-place").style.left = `${(100 * Math.min(1, Math.max(0, share))).toFixed(2)}%`;
    const of = share === null ? "no path yet" : `${status.place_mm.toFixed(1)} of ${status.length_mm.toFixed(1)} mm`;
    set("loop-at", `${of} · ${places(status.axes)}`);
  }

  #refreshButtons(status, known, nowMs) {
    const stopped = status.state === "stopped";
    const still = !status.moves;
    const ready = status.length_mm !== null;
    $("mark-start").disabled = $("mark-goal").disabled = !known || !still;
    set("mark-start-at", places(status.start));
    set("mark-goal-at", places(status.goal));
    $("loop-begin").hidden = stopped;
    $("loop-release").hidden = !stopped;
    $("loop-begin").disabled = !known || !still || !ready;
    $("loop-release").disabled = !known;
    $("loop-retract").disabled = !known || stopped || status.state === "retract" || !ready;
    if (!still || stopped) this.#confirmUntil = -Infinity;
    const asks = nowMs < this.#confirmUntil;
    $("loop-begin").classList.toggle("warn", asks);
    const begin = still ? (ready ? "toward the goal" : "mark first") : "on its way";
    set("loop-begin-note", asks ? "moves: again" : begin);
    set("loop-retract-note", stopped ? "release first" : "back to start");
  }
}

/** "3.0 mm, 12°" of {advance_mm: 3, knob_deg: 12.3}. */
function places(axes) {
  const texts = Object.entries(axes).map(([name, value]) => {
    const [digits, unit] = UNITS[name.split("_").at(-1)] ?? [1, ""];
    return `${value.toFixed(digits).replace("-", "−")}${unit}`;
  });
  return texts.join(", ") || "not marked";
}
