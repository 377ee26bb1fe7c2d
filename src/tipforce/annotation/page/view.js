// Draws a frame with its line; knows where an image point is on the screen. Pixel centres are at whole numbers.

import { curveThrough } from "./spline.js";

const LINE = "#ffd600";
const EDGE = "rgba(0, 0, 0, 0.75)";
const MAX_SCALE = 40;
const MARGIN_PX = 14;

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.scale = 1;
    this.left = 0;
    this.top = 0;
    this.fitted = true;
    this.size = [1, 1];
    this.image = null;
  }

  show(image, width, height) {
    this.image = image;
    this.size = [width, height];
    if (this.fitted) this.fit();
  }

  get box() {
    return [this.canvas.clientWidth, this.canvas.clientHeight];
  }

  fit() {
    const [width, height] = this.box;
    const [u, v] = this.size;
    this.scale = Math.max(1e-3, Math.min((width - 2 * MARGIN_PX) / u, (height - 2 * MARGIN_PX) / v));
    this.left = (width - u * this.scale) / 2;
    this.top = (height - v * this.scale) / 2;
    this.fitted = true;
  }

  zoom(factor, x = this.box[0] / 2, y = this.box[1] / 2) {
    const [width, height] = this.box;
    const least = 0.5 * Math.min(width / this.size[0], height / this.size[1]);
    const scale = Math.min(MAX_SCALE, Math.max(least, this.scale * factor));
    this.left = x - ((x - this.left) * scale) / this.scale;
    this.top = y - ((y - this.top) * scale) / this.scale;
    this.scale = scale;
    this.fitted = false;
  }

  pan(dx, dy) {
    const [width, height] = this.box;
    const keep = 60;  // px of the image that stay in view
    this.left = Math.min(width - keep, Math.max(keep - this.size[0] * this.scale, this.left + dx));
    this.top = Math.min(height - keep, Math.max(keep - this.size[1] * this.scale, this.top + dy));
    this.fitted = false;
  }

  toScreen([u, v]) {
    return [this.left + (u + 0.5) * this.scale, this.top + (v + 0.5) * this.scale];
  }

  toImage([x, y]) {
    return [(x - this.left) / this.scale - 0.5, (y - this.top) / this.scale - 0.5];
  }

  draw(marks, { selected, drawing, hover }) {
    const [width, height] = this.box;
    const ratio = window.devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio)) this.canvas.width = Math.round(width * ratio);
    if (this.canvas.height !== Math.round(height * ratio)) this.canvas.height = Math.round(height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (!this.image) return;
    pen.imageSmoothingEnabled = this.scale < 3;
    pen.globalAlpha = marks.present ? 1 : 0.35;
    pen.drawImage(this.image, this.left, this.top, this.size[0] * this.scale, this.size[1] * this.scale);
    pen.globalAlpha = 1;
    if (!marks.present) return;
    const points = marks.points.map((point) => this.toScreen(point));
    this.drawLine(pen, points, marks.hidden);
    if (drawing && hover && points.length) this.drawNext(pen, points.at(-1), hover);
    points.forEach((point, k) => this.drawHandle(pen, point, k, points.length, { selected: k === selected, hidden: marks.hidden }));
  }

  drawLine(pen, points, hidden) {
    const curve = curveThrough(points);
    if (curve.length < 2) return;
    const end = hidden ? curve.findIndex(([, , piece]) => piece === points.length - 2) : curve.length - 1;
    const stroke = (from, to, dash) => {
      pen.setLineDash(dash);
      for (const [colour, thick] of [[EDGE, 4.5], [LINE, 2.2]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = thick;
        pen.beginPath();
        curve.slice(from, to + 1).forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        pen.stroke();
      }
      pen.setLineDash([]);
    };
    pen.lineJoin = "round";
    stroke(0, end, []);
    if (hidden) stroke(end, curve.length - 1, [6, 6]);
  }

  drawNext(pen, from, to) {
    pen.setLineDash([3, 5]);
    pen.strokeStyle = LINE;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...to);
    pen.stroke();
    pen.setLineDash([]);
  }

  drawHandle(pen, [x, y], index, count, { selected, hidden }) {
    const base = index === 0;
    const tip = index === count - 1 && count > 1;
    const radius = base || tip ? 7 : 5.5;
    pen.beginPath();
    if (base) pen.rect(x - radius, y - radius, 2 * radius, 2 * radius);
    else pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.fillStyle = tip && hidden ? "rgba(0, 0, 0, 0.35)" : selected ? "#ffffff" : base || tip ? LINE : "rgba(255, 214, 0, 0.75)";
    pen.fill();
    pen.lineWidth = 2;
    pen.strokeStyle = tip && hidden ? LINE : "#000";
    pen.stroke();
    if (selected) {
      pen.beginPath();
      pen.arc(x, y, radius + 5, 0, 2 * Math.PI);
      pen.strokeStyle = "#ffffff";
      pen.stroke();
    }
    if (base || tip) this.label(pen, base ? "base" : hidden ? "tip, hidden" : "tip", x, y, radius);
  }

  label(pen, text, x, y, radius) {
    pen.font = "600 15px system-ui, sans-serif";
    const width = pen.measureText(text).width;
    const [boxWidth] = this.box;
    const left = Math.min(Math.max(6, x - width / 2), boxWidth - width - 6);
    const top = y - radius - 9 > 18 ? y - radius - 9 : y + radius + 20;
    pen.lineWidth = 4;
    pen.strokeStyle = "rgba(0, 0, 0, 0.85)";
    pen.strokeText(text, left, top);
    pen.fillStyle = "#fff";
    pen.fillText(text, left, top);
  }
}
