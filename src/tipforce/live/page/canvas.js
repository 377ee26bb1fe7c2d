// Functions of all canvases: sharp at any pixel density, colours from the style sheet.

/** A canvas as large as it is shown. @returns the context in CSS pixels, with width and height */
export function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

let palette = null;

/** The colours of the present theme by name: `colours().window` is --window of the style sheet. */
export function colours() {
  if (!palette) {
    const style = getComputedStyle(document.documentElement);
    const names = ["ink", "dim", "line", "ground", "force", "window", "limit", "invalid"];
    palette = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return palette;
}

export function forgetColours() {
  palette = null;
}

export const font = (pixels, weight = 500) => `${weight} ${pixels}px system-ui, "DejaVu Sans", sans-serif`;

/** Diagonal hatching over a rectangle: "not known" without a colour. */
export function hatch(context, left, top, width, height, colour, step) {
  if (width <= 0) return;
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.strokeStyle = colour;
  context.lineWidth = 1.5;
  context.globalAlpha = 0.6;
  context.beginPath();
  const first = Math.floor((left - height) / step) * step; // the hatching moves with the drawing, not with its edge
  for (let x = first; x < left + width; x += step) {
    context.moveTo(x, top + height);
    context.lineTo(x + height, top);
  }
  context.stroke();
  context.restore();
}
