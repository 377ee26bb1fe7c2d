// The last ten seconds: force with its interval, window and limit; hatched where there was no valid force.

import { colours, fit, font, hatch } from "./canvas.js";
import { fullScale } from "./gauge.js";
import { grams, inGrams } from "./numbers.js";

const SPAN_MS = 10_000;
const GAP_MS = 250; // nothing is drawn across a longer time without frames
const STEPS_G = [5, 10, 20, 50, 100, 200, 500];

export class Trace {
  #points = [];

  /** Takes an update, and those just before it that did not reach this page. */
  add(update) {
    const { status, magnitude_n: force, interval_n: interval, recent } = update.values;
    const last = this.#points.at(-1);
    if (last && update.capturedMs < last.at) this.#points = []; // another engine: its clock begins elsewhere
    for (const [at, ...values] of recent ?? []) {
      if (last && at > last.at && at < update.capturedMs) this.#push(at, ...values);
    }
    this.#push(update.capturedMs, status === "valid" ? force : null, ...interval);
    const first = this.#points.findIndex((point) => point.at >= update.capturedMs - 2 * SPAN_MS);
    if (first > 0) this.#points.splice(0, first);
  }

  /** A force that is null was not valid. */
  #push(at, force, low, high) {
    if (this.#points.at(-1)?.at === at) this.#points.pop(); // a later estimate for the same image
    const [from, to] = low === null || high === null ? [force, force] : [low, high];
    this.#points.push({ at, valid: force !== null, force, low: from, high: to });
  }

  /** Describes the last ten seconds in words. @param {number} nowMs the engine's clock at the right edge */
  described(nowMs) {
    const points = this.#points.filter((point) => point.at >= nowMs - SPAN_MS);
    const forces = points.filter((point) => point.valid).map((point) => point.force);
    if (!forces.length) return "Force over the last 10 s: none was valid";
    const ends = [Math.min(...forces), Math.max(...forces)].map((force) => `${inGrams(force)} g`);
    return `Force over the last 10 s: ${ends.join(" to ")}, ${points.length - forces.length} of ${points.length} values not valid`;
  }

  /** @param {number} nowMs the engine's clock at the right edge */
  draw(canvas, contact, nowMs) {
    const { context, width, height } = fit(canvas);
    const paint = colours();
    const text = Math.max(12, Math.min(16, 0.09 * height));
    const [left, right, top, bottom] = [3.2 * text, width - 6, 6, height - 1.7 * text];
    const points = this.#points.filter((point) => point.at >= nowMs - SPAN_MS - GAP_MS);
    const most = Math.max(fullScale(contact), ...points.map((point) => 1.05 * (point.high ?? 0)));
    const x = (at) => right - ((right - left) * (nowMs - at)) / SPAN_MS;
    const y = (newtons) => bottom - ((bottom - top) * newtons) / most;
    const low = y(Math.min(contact.window_n[1], most));
    context.fillStyle = paint.window;
    context.globalAlpha = 0.22;
    context.fillRect(left, low, right - left, y(contact.window_n[0]) - low);
    context.globalAlpha = 1;
    this.#scale(context, { left, right, bottom, width, height, text, most, y, paint });
    context.save();
    context.beginPath();
    context.rect(left, 0, right - left, height);
    context.clip();
    this.#unknown(context, points, x, nowMs, left, right, top, bottom, paint);
    for (const run of runs(points)) this.#run(context, run, x, y, paint);
    context.restore();
    context.strokeStyle = paint.limit;
    context.lineWidth = 2.5;
    context.setLineDash([9, 5]);
    context.beginPath();
    context.moveTo(left, y(contact.limit_n));
    context.lineTo(right, y(contact.limit_n));
    context.stroke();
    context.setLineDash([]);
    context.fillStyle = paint.limit;
    context.font = font(text, 600);
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText("limit", left + 6, y(contact.limit_n) - 2);
    context.fillStyle = paint.window;
    context.textBaseline = "bottom";
    context.fillText("window", left + 6, y(contact.window_n[0]) - 3);
  }

  #scale(context, { left, right, bottom, height, text, most, y, paint }) {
    const step = STEPS_G.find((value) => grams(most) / value <= 5) ?? STEPS_G.at(-1);
    context.font = font(text);
    context.fillStyle = paint.dim;
    context.strokeStyle = paint.line;
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (let value = 0; value < grams(most); value += step) {
      const at = Math.round(y((value / grams(most)) * most)) + 0.5;
      context.beginPath();
      context.moveTo(left, at);
      context.lineTo(right, at);
      context.stroke();
      context.fillText(value ? String(value) : "0 g", left - 6, at - (value ? 0 : 3));
    }
    context.textBaseline = "bottom";
    for (let ago = 0; ago <= 10; ago += right - left < 320 ? 5 : 2) {
      const x = right - ((right - left) * ago) / 10;
      context.textAlign = ago ? "center" : "right";
      context.fillText(ago ? `−${ago}` : "now (s)", x, height - 2);
      context.beginPath();
      context.moveTo(Math.round(x) + 0.5, bottom);
      context.lineTo(Math.round(x) + 0.5, bottom + 4);
      context.stroke();
    }
  }

  /** Hatches every stretch without a valid force: before the first value, in gaps, and after the last one. */
  #unknown(context, points, x, nowMs, left, right, top, bottom, paint) {
    const beginMs = nowMs - SPAN_MS;
    let from = points.length && points[0].at <= beginMs + GAP_MS ? null : beginMs;
    const until = (at) => {
      if (from !== null) hatch(context, x(from), top, x(at) - x(from), bottom - top, paint.invalid, 12);
      from = null;
    };
    let before = null;
    for (const point of points) {
      if (before !== null && point.at - before > GAP_MS) from ??= before;
      if (point.valid) until(point.at);
      else from ??= point.at;
      before = point.at;
    }
    if (before === null || nowMs - before > GAP_MS) from ??= before;
    until(nowMs);
  }

  #run(context, run, x, y, paint) {
    context.beginPath();
    run.forEach(({ at, high }) => context.lineTo(x(at), Math.max(0, y(high))));
    [...run].reverse().forEach(({ at, low }) => context.lineTo(x(at), y(low)));
    context.closePath();
    context.globalAlpha = 0.35;
    context.fillStyle = paint.force;
    context.fill();
    context.globalAlpha = 1;
    context.beginPath();
    run.forEach(({ at, force }) => context.lineTo(x(at), y(force)));
    context.strokeStyle = paint.force;
    context.lineWidth = 3;
    context.lineJoin = "round";
    context.stroke();
  }
}

/** Valid points that follow each other without a gap. */
function runs(points) {
  const found = [];
  let before = null;
  for (const point of points) {
    if (point.valid) {
      if (!before?.valid || point.at - before.at > GAP_MS) found.push([]);
      found.at(-1).push(point);
    }
    before = point;
  }
  return found;
}
