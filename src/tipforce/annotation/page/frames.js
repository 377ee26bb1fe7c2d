// The frames and their marks: what the person changed, undo and redo, and saving after every change.

import * as api from "./api.js";

const RETRY_MS = 2000;

const copied = (points) => points.map(([u, v]) => [u, v]);
const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);

export class Frames {
  constructor(state, listen) {
    this.listen = listen;  // (event, text): "changed", "saving", "saved", "unsaved"
    this.list = state.frames.map((frame) => ({
      name: frame.image,
      width: frame.width,
      height: frame.height,
      proposal: frame.proposal,
      marks: frame.points_px.length || frame.done || !frame.present
        ? { points: frame.points_px, hidden: frame.tip_hidden, present: frame.present, done: frame.done }
        : null,
    }));
    this.past = [];
    this.future = [];
    this.unsaved = new Set();
    this.sending = false;
  }

  // The marks that are shown: those of the person, or the proposal.
  shown(index) {
    const { marks, proposal } = this.list[index];
    return marks ?? { points: proposal.points_px, hidden: false, present: true, done: false };
  }

  state(index) {
    const { marks } = this.list[index];
    if (!marks) return "todo";
    if (!marks.done) return "marked";
    return marks.present ? "done" : "none";
  }

  get finished() {
    return this.list.filter(({ marks }) => marks?.done).length;
  }

  get withCatheter() {
    return this.list.filter(({ marks }) => marks?.done && marks.present).length;
  }

  nextUnfinished(index) {
    const count = this.list.length;
    for (let step = 1; step <= count; step++) {
      const next = (index + step) % count;
      if (!this.list[next].marks?.done) return next;
    }
    return -1;
  }

  // Changes marks, so that the change can be undone. A line with less than two points is not finished.
  change(index, values) {
    const before = this.list[index].marks;
    const shown = this.shown(index);
    const marks = { ...shown, points: copied(shown.points), ...values };
    if (marks.present && marks.points.length < 2) marks.done = false;
    if (same(before, marks)) return;
    this.past.push({ index, before, after: marks });
    this.future = [];
    this.put(index, marks);
  }

  undo() {
    const step = this.past.pop();
    if (!step) return -1;
    this.future.push(step);
    this.put(step.index, step.before);
    return step.index;
  }

  redo() {
    const step = this.future.pop();
    if (!step) return -1;
    this.past.push(step);
    this.put(step.index, step.after);
    return step.index;
  }

  put(index, marks) {
    this.list[index].marks = marks;
    this.unsaved.add(index);
    this.listen("changed");
    this.save();
  }

  // Returns when all changes are saved; throws where one cannot be.
  async settle() {
    while (this.sending) await new Promise((resolve) => setTimeout(resolve, 20));
    if (this.unsaved.size) throw new Error("Not saved yet: the program cannot write the last change.");
  }

  async save() {
    if (this.sending) return;
    this.sending = true;
    let lost = "";
    while (this.unsaved.size && !lost) {
      const index = this.unsaved.values().next().value;
      this.unsaved.delete(index);
      this.listen("saving");
      const marks = this.list[index].marks ?? { points: [], hidden: false, present: true, done: false };
      try {
        const state = await api.mark(index, {
          points_px: marks.points, tip_hidden: marks.hidden, present: marks.present, done: marks.done,
        });
        state.frames.forEach((frame, k) => { this.list[k].proposal = frame.proposal; });
      } catch (error) {
        this.unsaved.add(index);
        lost = error.message;
      }
    }
    this.sending = false;
    if (lost) {
      this.listen("unsaved", lost);
      setTimeout(() => this.save(), RETRY_MS);
    } else {
      this.listen("saved");
    }
    this.listen("changed");
  }
}
