// The page: which frame is shown, buttons and keys.

import * as api from "./api.js";
import { Editor } from "./editor.js";
import { Frames } from "./frames.js";
import { Strip } from "./strip.js";
import { Training } from "./training.js";
import { View } from "./view.js";

const ZOOM = 1.4;

const element = (id) => document.getElementById(id);

const state = await api.state();
const view = new View(element("image"));
let current = 0;

const frames = new Frames(state, (event, text) => {
  if (event === "changed") refresh();
  else saved(event, text);
});
const strip = new Strip(element("strip"), frames, go);
const editor = new Editor(view, {
  marks: () => frames.shown(current),
  change: (values) => frames.change(current, values),
  redraw,
});
const training = new Training(frames, state.min_with_catheter, say);

element("title").textContent = state.title;
element("file").textContent = state.file;

let bare = false;  // the image is shown without the line

function redraw() {
  const marks = frames.shown(current);
  view.draw({ ...marks, points: bare ? [] : editor.points }, editor);
}

function showBare(on) {
  if (bare === on) return;
  bare = on;
  redraw();
}

function refresh() {
  const marks = frames.shown(current);
  const { name, proposal } = frames.list[current];
  const kind = frames.state(current);
  element("position").textContent = `Frame ${current + 1} of ${frames.list.length}`;
  element("name").textContent = name;
  element("origin").textContent = originOf(kind, proposal, marks);
  element("none-cover").hidden = marks.present;
  element("hidden").setAttribute("aria-pressed", marks.hidden);
  element("hidden").disabled = !marks.present;
  element("none").setAttribute("aria-pressed", !marks.present);
  element("draw").setAttribute("aria-pressed", editor.drawing);
  element("draw").disabled = !marks.present;
  element("delete").disabled = editor.selected < 0 || !marks.present;
  element("done").disabled = marks.present && marks.points.length < 2;
  element("done-word").textContent = kind === "done" || kind === "none" ? "Next" : "Done, next";
  element("undo").disabled = !frames.past.length;
  element("redo").disabled = !frames.future.length;
  element("count").textContent = `${frames.finished} of ${frames.list.length} done`;
  element("count-bar").max = frames.list.length;
  element("count-bar").value = frames.finished;
  element("image").setAttribute("aria-label",
    `Frame ${current + 1}: ${marks.present ? `a line of ${marks.points.length} points` : "no catheter"}`);
  strip.update(current);
  training.update();
  redraw();
}

function originOf(kind, proposal, marks) {
  if (kind === "done") return "Done. You can still change it.";
  if (kind === "none") return "Done: no catheter in this image.";
  if (!marks.present) return "No catheter in this image? Press Done.";
  if (editor.drawing) {
    if (marks.points.length) return "Click along the catheter; the last point is the tip.";
    const undetected = !frames.list[current].marks && proposal.detail;
    return `${undetected ? "No catheter was detected. Click its base" : "Click the base of the catheter"}, some points along it, and its tip.`;
  }
  if (kind === "marked") return "Changed by you. Press Done when the line is right.";
  if (proposal.carried_from) {
    const from = frames.list.findIndex(({ name }) => name === proposal.carried_from);
    return `Line carried over from frame ${from + 1}. Correct it, or press Done.`;
  }
  return "Line of the detector. Correct it, or press Done.";
}

async function go(index) {
  current = index;
  editor.reset();
  view.image = null;
  refresh();
  strip.reveal(index);
  try {
    const image = await api.image(`images/${index}`);
    if (current !== index) return;
    const { width, height } = frames.list[index];
    view.show(image, width, height);
    redraw();
    api.image(`images/${(index + 1) % frames.list.length}`).catch(() => {});
  } catch (error) {
    say(error.message);
  }
}

function step(by) {
  go((current + by + frames.list.length) % frames.list.length);
}

function done() {
  const marks = frames.shown(current);
  if (marks.present && marks.points.length < 2) {
    say("The line needs at least two points, base and tip. Or press N: no catheter in this image.", "note");
    return;
  }
  say("");
  frames.change(current, { done: true });
  const next = frames.nextUnfinished(current);
  if (next >= 0) go(next);
  else {
    editor.reset();
    refresh();
    say("All frames are done. Press Train.", "note");
  }
}

function toggleHidden() {
  const marks = frames.shown(current);
  if (marks.present) frames.change(current, { hidden: !marks.hidden });
}

function toggleNone() {
  const { present } = frames.shown(current);
  if (present) frames.change(current, { present: false, points: [], hidden: false });
  else frames.change(current, { present: true, points: frames.list[current].proposal.points_px, done: false });
  editor.reset();
  refresh();
}

function drawAgain() {
  if (!frames.shown(current).present) return;
  if (editor.appending && frames.shown(current).points.length > 1) editor.appending = false;
  else {
    frames.change(current, { points: [], done: false });
    editor.selected = -1;
    editor.appending = true;
  }
  refresh();
}

function restore(index) {
  if (index < 0) return;
  if (index === current) {
    editor.reset();
    refresh();
  } else go(index);
}

function zoom(factor) {
  view.zoom(factor);
  redraw();
}

function fit() {
  view.fit();
  redraw();
}

function saved(event, text) {
  const words = { saving: "saving ...", saved: "all changes saved", unsaved: "NOT SAVED" };
  element("saved").textContent = words[event];
  element("saved").dataset.state = event;
  if (event === "unsaved") say(text);
  else if (event === "saved" && element("message").dataset.kind === "unsaved") say("");
  if (event === "unsaved") element("message").dataset.kind = "unsaved";
}

function say(text, kind = "error") {
  element("message").hidden = !text;
  element("message").dataset.kind = kind;
  element("message").textContent = text;
}

const leave = element("leave");

async function finish() {
  try {
    await frames.settle();
    await api.finish();
    element("closed").showModal();
  } catch (error) {
    say(error.message);
  }
}

const ACTIONS = {
  done, undo: () => restore(frames.undo()), redo: () => restore(frames.redo()),
  previous: () => step(-1), next: () => step(1),
  hidden: toggleHidden, none: toggleNone, draw: drawAgain, delete: () => editor.remove(),
  "zoom-in": () => zoom(ZOOM), "zoom-out": () => zoom(1 / ZOOM), fit,
  help: () => element("keys").showModal(),
  finish: () => (training.last === "running" || frames.finished < frames.list.length ? leave.showModal() : finish()),
  "leave-now": finish,
};
for (const [id, act] of Object.entries(ACTIONS)) {
  element(id).addEventListener("click", (event) => {
    act();
    if (event.detail && !document.querySelector("dialog[open]")) view.canvas.focus({ preventScroll: true });
  });
}

const KEYS = {
  ArrowLeft: ACTIONS.previous, ArrowRight: ACTIONS.next, h: toggleHidden, n: toggleNone, r: drawAgain,
  Delete: ACTIONS.delete, Backspace: ACTIONS.delete, z: ACTIONS.undo, y: ACTIONS.redo,
  "+": ACTIONS["zoom-in"], "=": ACTIONS["zoom-in"], "-": ACTIONS["zoom-out"], 0: fit, f: fit,
  "[": () => editor.select(-1), "]": () => editor.select(1), i: () => editor.insert(), "?": ACTIONS.help,
  Escape: () => { editor.selected = -1; editor.appending = false; refresh(); },
};
const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

document.addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]") || event.altKey) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const command = event.ctrlKey || event.metaKey;
  const onButton = event.target instanceof HTMLButtonElement;
  let act = null;
  if (command) act = key === "z" ? (event.shiftKey ? ACTIONS.redo : ACTIONS.undo) : key === "y" ? ACTIONS.redo : null;
  else if (event.shiftKey && MOVES[key]) act = () => editor.nudge(...MOVES[key]);
  else if (key === "Enter") act = onButton ? null : done;
  else if (key === " ") act = onButton ? null : () => showBare(true);
  else act = KEYS[key] ?? null;
  if (!act) return;
  event.preventDefault();
  act();
  element("delete").disabled = editor.selected < 0;
});

document.addEventListener("keyup", (event) => { if (event.key === " ") showBare(false); });
window.addEventListener("blur", () => showBare(false));

new ResizeObserver(() => {
  if (view.fitted) view.fit();
  redraw();
}).observe(element("stage"));

view.canvas.addEventListener("pointerup", () => { element("delete").disabled = editor.selected < 0; });

await go(Math.max(0, frames.nextUnfinished(-1)));
training.show(state.training);
document.body.dataset.ready = "true";
