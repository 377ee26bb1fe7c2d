// Mouse, pen and fingers on the image: drag, insert, append and delete points; zoom and pan.

import { curveThrough } from "./spline.js";

const CLICK_PX = 4;
const REACH = { mouse: [12, 8], pen: [16, 10], touch: [26, 16] };  // px of the screen: to a point, to the line
const WHEEL_STEP = 0.0016;

export class Editor {
  constructor(view, { marks, change, redraw }) {
    Object.assign(this, { view, marks, change, redraw });
    this.selected = -1;
    this.appending = false;  // clicks append points to a line that has some already
    this.pointers = new Map();
    this.drag = null;  // {kind: "point" | "pan", ...}
    this.hover = null;
    const canvas = view.canvas;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => this.up(event));
    canvas.addEventListener("pointerleave", () => { this.hover = null; this.redraw(); });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  // The points that are shown: while one is dragged, with its new position.
  get points() {
    return this.drag?.points ?? this.marks().points;
  }

  reset() {
    this.selected = -1;
    this.drag = null;
    this.appending = false;
  }

  // Whether a click on the ground appends a point.
  get drawing() {
    const { present, points } = this.marks();
    return present && (this.appending || points.length < 2);
  }

  at(event) {
    const box = this.view.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  nearest(place, reach) {
    let best = -1;
    let least = reach;
    this.points.forEach((point, k) => {
      const [x, y] = this.view.toScreen(point);
      const distance = Math.hypot(x - place[0], y - place[1]);
      if (distance <= least) [best, least] = [k, distance];
    });
    return best;
  }

  // The piece of the line that is next to a place; -1 where none is near.
  pieceAt(place, reach) {
    const curve = curveThrough(this.points.map((point) => this.view.toScreen(point)));
    let best = -1;
    let least = reach;
    for (const [x, y, piece] of curve) {
      const distance = Math.hypot(x - place[0], y - place[1]);
      if (distance <= least) [best, least] = [piece, distance];
    }
    return this.points.length > 1 ? best : -1;
  }

  down(event) {
    this.view.canvas.focus({ preventScroll: true });
    this.view.canvas.setPointerCapture(event.pointerId);
    const place = this.at(event);
    this.pointers.set(event.pointerId, place);
    if (this.pointers.size === 2) {
      this.drag = null;
      return;
    }
    const [toPoint, toLine] = REACH[event.pointerType] ?? REACH.mouse;
    const present = this.marks().present;
    const point = present ? this.nearest(place, toPoint) : -1;
    if (event.button === 2) {
      if (point >= 0) this.remove(point);
      return;
    }
    if (event.button === 1) {
      this.drag = { kind: "pan", from: place, moved: true };
    } else if (point >= 0) {
      this.selected = point;
      this.drag = { kind: "point", index: point, from: place, start: this.points[point], points: this.copy() };
    } else {
      const piece = present && !this.drawing ? this.pieceAt(place, toLine) : -1;
      if (piece >= 0) {
        const points = this.copy();
        points.splice(piece + 1, 0, this.view.toImage(place));
        this.selected = piece + 1;
        this.drag = { kind: "point", index: piece + 1, from: place, start: points[piece + 1], points, inserted: true };
      } else {
        this.drag = { kind: "pan", from: place, moved: false };
      }
    }
    this.redraw();
  }

  move(event) {
    const place = this.at(event);
    this.hover = place;
    const before = this.pointers.get(event.pointerId);
    if (before) this.pointers.set(event.pointerId, place);
    if (this.pointers.size === 2 && before) {
      this.pinch(event.pointerId, before, place);
    } else if (this.drag?.kind === "point") {
      const { from, start, index, points } = this.drag;
      const scale = this.view.scale;
      points[index] = this.inside([start[0] + (place[0] - from[0]) / scale, start[1] + (place[1] - from[1]) / scale]);
      this.drag.moved ||= Math.hypot(place[0] - from[0], place[1] - from[1]) > 1;
    } else if (this.drag?.kind === "pan" && before) {
      const far = Math.hypot(place[0] - this.drag.from[0], place[1] - this.drag.from[1]) > CLICK_PX;
      if (far || this.drag.moved) {
        this.drag.moved = true;
        this.view.pan(place[0] - before[0], place[1] - before[1]);
      }
    } else {
      this.cursor(place);
    }
    this.redraw();
  }

  up(event) {
    const place = this.at(event);
    this.pointers.delete(event.pointerId);
    const drag = this.drag;
    this.drag = null;
    if (event.type === "pointercancel" || !drag) {
      this.redraw();
      return;
    }
    if (drag.kind === "point" && (drag.moved || drag.inserted)) {
      this.change({ points: drag.points });
    } else if (drag.kind === "pan" && !drag.moved) {
      if (this.drawing) this.append(this.view.toImage(place));
      else this.selected = -1;
    }
    this.redraw();
  }

  pinch(moved, before, place) {
    const [other] = [...this.pointers].filter(([id]) => id !== moved).map(([, where]) => where);
    const apart = (one, two) => Math.max(20, Math.hypot(one[0] - two[0], one[1] - two[1]));
    this.view.zoom(apart(place, other) / apart(before, other), (place[0] + other[0]) / 2, (place[1] + other[1]) / 2);
    this.view.pan((place[0] - before[0]) / 2, (place[1] - before[1]) / 2);
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaMode === 1 ? 20 * event.deltaY : event.deltaY;
    this.view.zoom(Math.exp(-WHEEL_STEP * Math.max(-200, Math.min(200, pixels))), ...this.at(event));
    this.redraw();
  }

  cursor(place) {
    const canvas = this.view.canvas;
    const present = this.marks().present;
    if (present && this.nearest(place, REACH.mouse[0]) >= 0) canvas.style.cursor = "grab";
    else if (this.drawing) canvas.style.cursor = "crosshair";
    else canvas.style.cursor = present && this.pieceAt(place, REACH.mouse[1]) >= 0 ? "copy" : "default";
  }

  copy() {
    return this.marks().points.map(([u, v]) => [u, v]);
  }

  // A point may be a little beyond the border, where the base is.
  inside([u, v]) {
    const [width, height] = this.view.size;
    const clip = (value, size) => Math.min(size - 1 + 0.05 * size, Math.max(-0.05 * size, value));
    return [clip(u, width), clip(v, height)];
  }

  append(point) {
    const points = this.copy();
    points.push(this.inside(point));
    this.selected = points.length - 1;
    this.appending = true;
    this.change({ points });
  }

  remove(index = this.selected) {
    const points = this.copy();
    if (index < 0 || index >= points.length) return;
    points.splice(index, 1);
    this.selected = Math.min(index, points.length - 1);
    this.change({ points });
    this.redraw();
  }

  // For the keyboard: the next point, a new point behind the selected one, a small step.
  select(step) {
    const count = this.points.length;
    if (!count) return;
    this.selected = this.selected < 0 ? (step > 0 ? 0 : count - 1) : (this.selected + step + count) % count;
    this.redraw();
  }

  insert() {
    const points = this.copy();
    if (this.selected < 0 || points.length < 2) return;
    const piece = Math.min(this.selected, points.length - 2);
    const middle = curveThrough(points).filter(([, , own]) => own === piece)[8];
    points.splice(piece + 1, 0, [middle[0], middle[1]]);
    this.selected = piece + 1;
    this.change({ points });
    this.redraw();
  }

  nudge(du, dv) {
    const points = this.copy();
    if (this.selected < 0 || this.selected >= points.length) return;
    const [u, v] = points[this.selected];
    points[this.selected] = this.inside([u + du, v + dv]);
    this.change({ points });
    this.redraw();
  }
}
