// The force as a bar, with window, limit and interval.

import { colours, fit, font } from "./canvas.js";
import { grams } from "./numbers.js";

/** The end of the scale, in newtons. */
export const fullScale = (contact) => Math.max(1.5 * contact.limit_n, 1.15 * contact.window_n[1]);

/**
 * @param {HTMLCanvasElement} canvas
 * @param {object} contact window and limit
 * @param {object|null} values of a live update, or null: the scale alone
 */
export function drawGauge(canvas, contact, values) {
  const { context, width, height } = fit(canvas);
  const paint = colours();
  const text = Math.max(12, Math.min(20, 0.26 * height));
  const [left, right] = [2, width - 2];
  const [top, bottom] = [4, height - 1.35 * text];
  const at = (newtons) => left + ((right - left) * Math.min(newtons, fullScale(contact))) / fullScale(contact);
  context.fillStyle = paint.line;
  context.fillRect(left, top, right - left, bottom - top);
  const [low, high] = contact.window_n.map(at);
  context.globalAlpha = 0.4;
  context.fillStyle = paint.window;
  context.fillRect(low, top, high - low, bottom - top);
  context.globalAlpha = 1;
  context.strokeStyle = paint.window;
  context.lineWidth = 2;
  context.strokeRect(low, top, high - low, bottom - top);
  const middle = (top + bottom) / 2;
  if (values) {
    context.fillStyle = paint.ink;
    const [from, to] = values.interval_n;
    if (from !== null && to !== null) {
      const thick = Math.max(4, 0.16 * (bottom - top));
      context.fillRect(at(from), middle - thick / 2, Math.max(2, at(to) - at(from)), thick);
      for (const end of [from, to]) context.fillRect(at(end) - 1.5, middle - 2 * thick, 3, 4 * thick);
    }
    const wide = Math.max(8, 0.2 * (bottom - top));
    context.strokeStyle = paint.ground;
    context.lineWidth = 3;
    context.strokeRect(at(values.magnitude_n) - wide / 2, top, wide, bottom - top);
    context.fillStyle = paint.force;
    context.fillRect(at(values.magnitude_n) - wide / 2, top, wide, bottom - top);
  }
  context.strokeStyle = paint.limit;
  context.lineWidth = 4;
  context.setLineDash([7, 4]);
  context.beginPath();
  context.moveTo(at(contact.limit_n), top - 4);
  context.lineTo(at(contact.limit_n), bottom + 4);
  context.stroke();
  context.setLineDash([]);
  context.font = font(text, 600);
  context.textBaseline = "bottom";
  const end = label(context, grams(contact.window_n[0]).toFixed(0), low, height, paint.window, width, 0);
  const same = contact.window_n[1] === contact.limit_n;
  const next = same ? end : label(context, grams(contact.window_n[1]).toFixed(0), high, height, paint.window, width, end);
  label(context, `limit ${grams(contact.limit_n).toFixed(0)} g`, at(contact.limit_n), height, paint.limit, width, next);
  label(context, "0", left, height, paint.dim, width, 0);
}

/** A word below `x`, not before `from`. @returns where the next one may begin */
function label(context, text, x, y, colour, width, from) {
  const half = context.measureText(text).width / 2;
  const middle = Math.min(Math.max(x, from + half), width - half);
  context.textAlign = "center";
  context.fillStyle = colour;
  context.fillText(text, middle, y);
  return middle + half + 8;
}
