// Decides when there is an alarm, and its sound. Modelled on IEC 60601-1-8, high priority; no conformity is claimed.

import { passesLimit } from "./judge.js";

export const AUDIO_PAUSE_MS = 120_000;
const LEAST_MS = 1000; // shortest alarm, so that it does not flicker when the force oscillates about the limit
const HELD_MS = 60_000; // an alarm whose force is no longer known stays for this time, because its end is not known

const PULSE_S = 0.15;
const SPACE_S = 0.1;
const MIDDLE_S = 0.5;
const BETWEEN_BURSTS_S = 3.0;
export const FUNDAMENTAL_HZ = 523.25;
export const HARMONICS = [0, 1, 0.8, 0.7, 0.6, 0.5]; // of the sine terms, from the constant on

/** The ten pulses of one burst. @returns {{start: number, length: number}[]} in seconds from its beginning */
export function burst() {
  const long = 2 * SPACE_S + PULSE_S;
  const spaces = [SPACE_S, SPACE_S, long, SPACE_S, MIDDLE_S, SPACE_S, SPACE_S, long, SPACE_S];
  const pulses = [{ start: 0, length: PULSE_S }];
  for (const space of spaces) pulses.push({ start: pulses.at(-1).start + PULSE_S + space, length: PULSE_S });
  return pulses;
}

/** Seconds from the beginning of one burst to that of the next. */
export function burstPeriod() {
  const last = burst().at(-1);
  return last.start + last.length + BETWEEN_BURSTS_S;
}

export class Alarm {
  on = false;
  held = false;
  #lastMs = -Infinity;
  #pausedUntilMs = -Infinity;

  /** @param {object|null} values of a live and valid update, or null where there is none */
  update(values, limitN, nowMs) {
    if (values && passesLimit(values, limitN)) {
      this.on = true;
      this.#lastMs = nowMs;
    } else if (nowMs - this.#lastMs > (values ? LEAST_MS : HELD_MS)) this.on = false;
    this.held = this.on && !values;
  }

  togglePause(nowMs) {
    this.#pausedUntilMs = this.pausedFor(nowMs) ? -Infinity : nowMs + AUDIO_PAUSE_MS;
  }

  /** Remaining time of the audio pause in ms; 0 without a pause. */
  pausedFor(nowMs) {
    return Math.max(0, this.#pausedUntilMs - nowMs);
  }
}
