// The strip of small images: which frames there are, their lines and states.

import * as api from "./api.js";
import { curveThrough } from "./spline.js";

const WIDTH = 144;
const WORDS = { todo: "to do", marked: "changed", done: "done", none: "no catheter" };
const SIGNS = { todo: "○", marked: "◐", done: "✓", none: "∅" };

export class Strip {
  constructor(list, frames, go) {
    this.frames = frames;
    this.items = frames.list.map((frame, index) => {
      const button = document.createElement("button");
      const canvas = document.createElement("canvas");
      const number = document.createElement("span");
      const state = document.createElement("span");
      button.type = "button";
      button.className = "thumbnail";
      canvas.width = 2 * WIDTH;
      canvas.height = Math.round((2 * WIDTH * frame.height) / frame.width);
      canvas.setAttribute("aria-hidden", "true");
      number.className = "number";
      number.textContent = index + 1;
      state.className = "state";
      button.append(canvas, number, state);
      button.addEventListener("click", () => go(index));
      const item = document.createElement("li");
      item.append(button);
      list.append(item);
      return { button, canvas, state, shown: "" };
    });
  }

  update(current) {
    this.items.forEach(({ button, state }, index) => {
      const kind = this.frames.state(index);
      button.dataset.state = kind;
      state.textContent = `${SIGNS[kind]} ${WORDS[kind]}`;
      button.setAttribute("aria-label", `Frame ${index + 1}: ${WORDS[kind]}`);
      if (index === current) button.setAttribute("aria-current", "true");
      else button.removeAttribute("aria-current");
      this.draw(index);
    });
  }

  reveal(current) {
    const { button } = this.items[current];
    const list = button.closest("ol");
    list.scrollTo({ left: button.offsetLeft - list.offsetLeft - (list.clientWidth - button.offsetWidth) / 2 });
  }

  async draw(index) {
    const { canvas } = this.items[index];
    const marks = this.frames.shown(index);
    const wanted = JSON.stringify([marks.points, marks.present, this.frames.state(index)]);
    if (this.items[index].shown === wanted) return;
    this.items[index].shown = wanted;
    const image = await api.image(`thumbnails/${index}`).catch(() => null);
    if (!image) return;
    const pen = canvas.getContext("2d");
    const scale = canvas.width / this.frames.list[index].width;
    pen.globalAlpha = marks.present ? 1 : 0.35;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(image, 0, 0, canvas.width, canvas.height);
    if (!marks.present) return;
    pen.globalAlpha = 1;
    pen.lineWidth = 4;
    pen.strokeStyle = this.frames.state(index) === "todo" ? "rgba(255, 214, 0, 0.65)" : "#ffd600";
    pen.setLineDash(this.frames.state(index) === "todo" ? [7, 6] : []);
    pen.beginPath();
    curveThrough(marks.points, 8).forEach(([u, v], k) => {
      const at = [(u + 0.5) * scale, (v + 0.5) * scale];
      if (k) pen.lineTo(...at);
      else pen.moveTo(...at);
    });
    pen.stroke();
    pen.setLineDash([]);
  }
}
