// The image with the detected centreline, base frame, tip and force.

import { fit, font } from "./canvas.js";
import { inGrams } from "./numbers.js";

// The image is the same in every theme, so these colours are fixed; they differ in lightness, and letters name them.
const CENTRELINE = "#ffd60a";
const AXIS_X = "#ff9f43";
const AXIS_Y = "#6ec8ff";
const AXIS_Z = "#b9f27c";
const TIP = "#ffffff";
const FORCE = "#00e5ff";
const RIM = "rgba(0, 0, 0, 0.75)";
const LEAST_ARROW_PX = 12;
const LEAST_AXIS = 0.3; // of its length; a shorter one points to the viewer
const LONGEST_ARROW = 1.6; // times the arrow of the limit

export class Scene {
  #canvas;
  #bitmap = null;
  #last = null; // the update that the image is of
  #shown = null; // the update whose force is shown as a number

  constructor(canvas) {
    this.#canvas = canvas;
  }

  /** The width, in pixels of the screen, that an image is shown with. */
  get widthPx() {
    return this.#canvas.clientWidth * (window.devicePixelRatio || 1);
  }

  /** Takes the next image, which is shown from the next `draw` on. */
  async load(jpeg) {
    const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    this.#bitmap?.close();
    this.#bitmap = bitmap;
  }

  /**
   * Draws the image with the shape that was detected in it, and the force that is shown as a number.
   * @param {object} last values of the update that the image is of
   * @param {object|null} shown values of the update whose force is shown as a number: arrow and number are one estimate
   * @param {number} limitN
   */
  draw(last, shown, limitN) {
    [this.#last, this.#shown] = [{ values: last, limitN }, shown];
    this.redraw();
  }

  redraw() {
    const { context, width, height } = fit(this.#canvas);
    if (!this.#bitmap || !this.#last) return;
    const bitmap = this.#bitmap;
    const scale = Math.min(width / bitmap.width, height / bitmap.height);
    const [left, top] = [(width - scale * bitmap.width) / 2, (height - scale * bitmap.height) / 2];
    context.imageSmoothingQuality = "high";
    context.drawImage(bitmap, left, top, scale * bitmap.width, scale * bitmap.height);
    const { values, limitN } = this.#last;
    if (!values.size) return;
    const perPixel = (scale * bitmap.width) / values.size[0];
    const size = 15 * Math.max(1, Math.min(width, height) / 480);
    for (const { view, begins_px } of values.panels) {
      const text = values.read.includes(view) ? view : `${view}, not read`;
      write(context, text, left + perPixel * begins_px + 0.6 * size, top + size, TIP, size, "left");
    }
    context.save();
    context.lineCap = context.lineJoin = "round";
    const unit = Math.max(1, Math.min(width, height) / 480);
    const limitPx = 0.25 * scale * Math.min(bitmap.width, bitmap.height);
    const alone = [{ view: values.view || values.views[0], begins_px: 0, scale: 1 }];
    for (const panel of values.panels.length ? values.panels : alone) {
      const shape = panel.view === values.read[0] ? values.shape : values.shapes_beside[panel.view];
      if (!shape) continue;
      // Pixel centres are at integers, so the image begins half a pixel before 0.
      const at = ([u, v]) => [
        left + perPixel * (panel.begins_px + panel.scale * (u + 0.5)),
        top + perPixel * panel.scale * (v + 0.5),
      ];
      this.#shape(context, shape, at, unit);
      if (this.#shown) this.#force(context, this.#shown, shape, at, unit, limitPx, limitN);
    }
    context.restore();
  }

  #shape(context, shape, at, unit) {
    const points = shape.centreline_px.map(at);
    for (const [colour, line] of [[RIM, 5.5], [CENTRELINE, 3]]) {
      context.strokeStyle = colour;
      context.lineWidth = line * unit;
      for (let k = 1; k < points.length; k++) {
        const visible = !shape.seen || (shape.seen[k - 1] && shape.seen[k]);
        if (!visible && k % 2) continue; // a hidden part is dashed
        context.beginPath();
        context.moveTo(...points[k - 1]);
        context.lineTo(...points[k]);
        context.stroke();
      }
    }
    const origin = at(shape.origin_px);
    for (const [k, [colour, letter]] of [[AXIS_X, "x"], [AXIS_Y, "y"], [AXIS_Z, "z"]].entries()) {
      const axis = shape.axes_px?.[k];
      if (!axis || Math.hypot(...axis) < LEAST_AXIS) continue; // it points to the viewer
      const head = [origin[0] + 46 * unit * axis[0], origin[1] + 46 * unit * axis[1]];
      arrow(context, origin, head, colour, 2.5 * unit);
      write(context, letter, head[0] + 12 * unit * axis[0], head[1] + 12 * unit * axis[1], colour, 15 * unit);
    }
    const [x, y] = points.at(-1);
    context.beginPath();
    context.arc(x, y, 4.5 * unit, 0, 2 * Math.PI);
    context.fillStyle = TIP;
    context.strokeStyle = RIM;
    context.lineWidth = 2 * unit;
    context.fill();
    context.stroke();
  }

  /** Draws the force of the tissue with its head on the tip. The limit is as long as a quarter of the image. */
  #force(context, values, shape, at, unit, limitPx, limitN) {
    const axes = shape.axes_px ?? [];
    const parts = values.force_n.slice(0, axes.length);
    if (!parts.length || parts.includes(null)) return;
    const direction = [0, 1].map((k) => parts.reduce((sum, part, axis) => sum + part * axes[axis][k], 0));
    const size = Math.hypot(...direction);
    const length = Math.min((limitPx * size) / limitN, LONGEST_ARROW * limitPx);
    if (!(length >= LEAST_ARROW_PX * unit)) return;
    const [dx, dy] = [direction[0] / size, direction[1] / size];
    const tip = at(shape.centreline_px.at(-1));
    const head = [tip[0] - 7 * unit * dx, tip[1] - 7 * unit * dy];
    const tail = [head[0] - length * dx, head[1] - length * dy];
    arrow(context, tail, head, FORCE, 5 * unit);
    const text = `${inGrams(values.magnitude_n)} g`;
    context.font = font(19 * unit, 700);
    const [half, high] = [context.measureText(text).width / 2, 10 * unit];
    const away = 5 * unit + Math.min(half / Math.abs(dx), high / Math.abs(dy)); // beyond the tail, in every direction
    write(context, text, tail[0] - away * dx, tail[1] - away * dy, FORCE, 19 * unit);
  }
}

function arrow(context, tail, head, colour, width) {
  const [dx, dy] = [head[0] - tail[0], head[1] - tail[1]];
  const length = Math.hypot(dx, dy);
  if (length < 1) return;
  const [ux, uy] = [dx / length, dy / length];
  const size = Math.min(0.6 * length, 3.2 * width + 3);
  const neck = [head[0] - size * ux, head[1] - size * uy];
  for (const [paint, more] of [[RIM, 2.5], [colour, 0]]) {
    context.strokeStyle = context.fillStyle = paint;
    context.lineWidth = width + more;
    context.beginPath();
    context.moveTo(...tail);
    context.lineTo(...neck);
    context.stroke();
    context.beginPath();
    context.moveTo(...head);
    context.lineTo(neck[0] - 0.5 * size * uy, neck[1] + 0.5 * size * ux);
    context.lineTo(neck[0] + 0.5 * size * uy, neck[1] - 0.5 * size * ux);
    context.closePath();
    if (more) {
      context.lineWidth = more;
      context.stroke();
    }
    context.fill();
  }
}

function write(context, text, x, y, colour, pixels, align = "center") {
  context.font = font(pixels, 700);
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineWidth = pixels / 4;
  context.strokeStyle = RIM;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}
