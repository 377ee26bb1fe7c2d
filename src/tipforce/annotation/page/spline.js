// The natural cubic spline through the points that a person drags; the program draws the same (_spline.py).

export function knotsOf(points) {
  const knots = [0];
  for (let k = 1; k < points.length; k++) {
    const chord = Math.hypot(points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]);
    knots.push(knots[k - 1] + Math.max(1e-6, Math.sqrt(chord)));
  }
  return knots;
}

// Second derivatives of one coordinate at the knots; zero at both ends.
function bending(knots, values) {
  const last = knots.length - 1;
  const second = new Array(last + 1).fill(0);
  const share = new Array(last + 1).fill(0);
  for (let k = 1; k < last; k++) {
    const left = knots[k] - knots[k - 1];
    const right = knots[k + 1] - knots[k];
    const slope = (values[k + 1] - values[k]) / right - (values[k] - values[k - 1]) / left;
    const pivot = 2 * (left + right) - left * share[k - 1];
    share[k] = right / pivot;
    second[k] = (6 * slope - left * second[k - 1]) / pivot;
  }
  for (let k = last - 1; k > 0; k--) second[k] -= share[k] * second[k + 1];
  return second;
}

function valueAt(knots, values, second, piece, t) {
  const width = knots[piece + 1] - knots[piece];
  const b = (t - knots[piece]) / width;
  const a = 1 - b;
  const bend = ((a * a * a - a) * second[piece] + (b * b * b - b) * second[piece + 1]) * (width * width) / 6;
  return a * values[piece] + b * values[piece + 1] + bend;
}

// Points of the curve, each as [u, v, piece]: piece k lies between the points k and k + 1.
export function curveThrough(points, perPiece = 16) {
  if (points.length < 2) return points.map(([u, v]) => [u, v, 0]);
  const knots = knotsOf(points);
  const columns = [0, 1].map((axis) => points.map((point) => point[axis]));
  const seconds = columns.map((values) => bending(knots, values));
  const curve = [];
  for (let piece = 0; piece < points.length - 1; piece++) {
    for (let step = 0; step < perPiece; step++) {
      const t = knots[piece] + ((knots[piece + 1] - knots[piece]) * step) / perPiece;
      curve.push([...columns.map((values, axis) => valueAt(knots, values, seconds[axis], piece, t)), piece]);
    }
  }
  const [u, v] = points.at(-1);
  curve.push([u, v, points.length - 2]);
  return curve;
}
