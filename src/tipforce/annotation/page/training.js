// The training: starting it, its progress, and the picture of before and after.

import * as api from "./api.js";
import { curveThrough } from "./spline.js";

const POLL_MS = 500;
const CARD_WIDTH = 420;
const MARKED = "#ffffff";
const BEFORE = "#ff8a5c";
const AFTER = "#00e5ff";

const element = (id) => document.getElementById(id);

export class Training {
  constructor(frames, minimum, say) {
    Object.assign(this, { frames, minimum, say });
    this.last = "idle";
    element("train").addEventListener("click", () => this.start());
    element("cancel").addEventListener("click", () => this.follow(api.cancel));
    element("show-result").addEventListener("click", () => element("result").showModal());
  }

  update() {
    const lacking = this.minimum - this.frames.withCatheter;
    const running = this.last === "running";
    element("train").disabled = lacking > 0;
    element("train").hidden = running;
    element("train-note").textContent = lacking > 0
      ? `${lacking} more ${lacking === 1 ? "frame" : "frames"} needed`
      : this.frames.withCatheter < 8 ? "works; 8 frames are better" : "about 3 minutes";
  }

  start() {
    this.say("");
    this.follow(async () => {
      await this.frames.settle();
      return api.train();
    });
  }

  async follow(request) {
    try {
      this.show(await request());
    } catch (error) {
      this.say(error.message);
    }
  }

  show(values) {
    const began = this.last !== "running" && values.state === "running";
    const ended = this.last === "running" && values.state !== "running";
    this.last = values.state;
    element("progress-panel").hidden = values.state !== "running";
    element("progress").value = values.share;
    element("step").textContent = values.step;
    element("seconds").textContent = `${Math.round(values.seconds)} s`;
    if (values.state === "failed") this.say(values.message);
    if (values.state === "cancelled" && ended) this.say("Training cancelled. The annotations are saved.", "note");
    if (values.state === "done") {
      this.result(values);
      if (ended) element("result").showModal();
    }
    element("show-result").hidden = values.state !== "done";
    this.update();
    if (values.state === "running") {
      if (began) this.say("");
      setTimeout(() => this.follow(api.training), POLL_MS);
    }
  }

  result(values) {
    element("result-place").textContent = values.message;
    element("result-time").textContent = `${Math.round(values.seconds)} s`;
    const cards = element("result-cards");
    cards.replaceChildren(...values.left_out.map((each) => this.card(each)));
    element("result-none").hidden = values.left_out.length > 0;
    element("result-figures").textContent = this.figures(values.left_out);
  }

  figures(leftOut) {
    const middle = (numbers) => numbers.sort((a, b) => a - b)[Math.floor(numbers.length / 2)];
    const error = (each, key) => {
      const points = this.frames.shown(each.index).points;
      const found = each[key];
      if (!points.length || !found.length) return Infinity;
      return Math.hypot(found.at(-1)[0] - points.at(-1)[0], found.at(-1)[1] - points.at(-1)[1]);
    };
    const shown = leftOut.filter(({ index }) => this.frames.shown(index).points.length);
    if (!shown.length) return "";
    const [before, after] = ["before_px", "after_px"].map((key) => middle(shown.map((each) => error(each, key))));
    const words = (value) => (Number.isFinite(value) ? `${value.toFixed(1)} px` : "not found");
    return `Tip, distance from your mark in the ${shown.length} frames left out (median): ${words(before)} before, ${words(after)} after.`;
  }

  card({ index, before_px, after_px }) {
    const frame = this.frames.list[index];
    const figure = document.createElement("figure");
    const canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    canvas.width = 2 * CARD_WIDTH;
    canvas.height = Math.round((2 * CARD_WIDTH * frame.height) / frame.width);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Frame ${index + 1} with your line, and the lines found before and after`);
    caption.textContent = `Frame ${index + 1}, not used in the training`;
    figure.append(canvas, caption);
    api.image(`images/${index}`).then((image) => {
      const pen = canvas.getContext("2d");
      const scale = canvas.width / frame.width;
      pen.drawImage(image, 0, 0, canvas.width, canvas.height);
      const marks = this.frames.shown(index);
      const lines = [
        [curveThrough(marks.points), MARKED, 9, []],
        [before_px, BEFORE, 4, [12, 8]],
        [after_px, AFTER, 4, []],
      ];
      for (const [points, colour, thick, dash] of lines) {
        for (const [stroke, width] of [["rgba(0, 0, 0, 0.6)", thick + 3], [colour, thick]]) {
          pen.strokeStyle = stroke;
          pen.lineWidth = width;
          pen.setLineDash(dash);
          pen.beginPath();
          points.forEach(([u, v], k) => {
            const at = [(u + 0.5) * scale, (v + 0.5) * scale];
            if (k) pen.lineTo(...at);
            else pen.moveTo(...at);
          });
          pen.stroke();
        }
      }
    }).catch(() => {});
    return figure;
  }
}
