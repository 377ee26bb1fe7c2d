// Numbers as people read them. null is a number that is not known.

const GRAM_N = 9.80665e-3; // one gram-force in newtons

export const NOTHING = "–";

export const grams = (newtons) => newtons / GRAM_N;

/** Grams with one decimal, whole ones from 100 on. */
export function inGrams(newtons, signed = false) {
  if (newtons === null) return NOTHING;
  const value = grams(newtons);
  const text = Math.abs(value).toFixed(Math.abs(value) < 99.95 ? 1 : 0);
  if (Number(text) === 0) return text;
  return (value < 0 ? "−" : signed ? "+" : "") + text;
}

export function inNewtons(newtons, digits = 3) {
  return newtons === null ? NOTHING : newtons.toFixed(digits).replace("-", "−");
}

export function seconds(milliseconds) {
  return milliseconds < 9950 ? `${(milliseconds / 1000).toFixed(1)} s` : duration(milliseconds / 1000);
}

/** m:ss, or h:mm:ss. */
export function duration(totalSeconds) {
  const whole = Math.floor(totalSeconds);
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (value) => String(value).padStart(2, "0");
  return h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** "12 s", "3 min", "2 h". */
export function roughly(totalSeconds) {
  if (totalSeconds < 60) return `${Math.floor(totalSeconds)} s`;
  if (totalSeconds < 3600) return `${Math.floor(totalSeconds / 60)} min`;
  return `${Math.floor(totalSeconds / 3600)} h`;
}
