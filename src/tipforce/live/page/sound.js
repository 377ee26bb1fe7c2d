// The two sounds: one that follows the force, and the alarm. Both are laid out ahead on the audio thread, which plays on
// when this script is held up: the tone ends by itself when its frame has grown old.

import { burst, burstPeriod, FUNDAMENTAL_HZ, HARMONICS } from "./alarm.js";

const LOW_HZ = 220; // at no force; two octaves higher at the limit, three at twice the limit and above
const TONE_LEVEL = 0.12;
const ALARM_LEVEL = 0.5;
const GLIDE_S = 0.03;
const KNOCK_MS = 1000; // without a valid force: a low knock at this interval, because silence means "no contact"

export class Sound {
  follows = false;
  #context = null;
  #tone = null;
  #toneLevel = null;
  #burst = null; // level of the scheduled burst; removed to silence it
  #nextBurst = 0;
  #knockedMs = 0;

  /** Browsers let a page sound after the first touch or key only: call this from one. */
  unlock() {
    if (!this.#context) this.#build();
    if (this.#context.state !== "running") this.#context.resume();
  }

  get unlocked() {
    return this.#context?.state === "running";
  }

  #build() {
    const context = new AudioContext({ latencyHint: "interactive" });
    this.#context = context;
    this.#toneLevel = new GainNode(context, { gain: 0 });
    this.#tone = new OscillatorNode(context, { type: "triangle", frequency: LOW_HZ });
    this.#tone.connect(this.#toneLevel).connect(context.destination);
    this.#tone.start();
  }

  /** A live force: heard for as long as its frame stays young. */
  force(forceN, contact, remainingMs) {
    if (!this.unlocked) return;
    const now = this.#context.currentTime;
    const heard = this.follows && forceN > contact.contact_n && remainingMs > 0;
    const level = this.#toneLevel.gain;
    level.cancelScheduledValues(now);
    level.setTargetAtTime(heard ? TONE_LEVEL : 0, now, GLIDE_S / 3);
    if (!heard) return;
    level.setTargetAtTime(0, now + remainingMs / 1000, GLIDE_S / 3);
    const octaves = 2 * Math.min(forceN / contact.limit_n, 1.5);
    this.#tone.frequency.setTargetAtTime(LOW_HZ * 2 ** octaves, now, GLIDE_S);
  }

  /** No valid force: the tone ends, and a knock sounds. */
  nothing(nowMs) {
    if (!this.unlocked) return;
    const now = this.#context.currentTime;
    this.#toneLevel.gain.cancelScheduledValues(now);
    this.#toneLevel.gain.setTargetAtTime(0, now, GLIDE_S / 3);
    if (!this.follows || nowMs - this.#knockedMs < KNOCK_MS) return;
    this.#knockedMs = nowMs;
    this.#pulse(this.#context.destination, now, 0.08, { frequency: 90, type: "sine" }, 3 * TONE_LEVEL);
  }

  /** Call often: lays out the next burst in time. */
  alarm(on, paused) {
    if (!this.unlocked) return;
    const now = this.#context.currentTime;
    if (!on || paused) {
      this.#burst?.disconnect();
      this.#burst = null;
      this.#nextBurst = now;
      return;
    }
    if (now < this.#nextBurst) return;
    this.#burst = new GainNode(this.#context, { gain: ALARM_LEVEL });
    this.#burst.connect(this.#context.destination);
    const wave = this.#context.createPeriodicWave(new Float32Array(HARMONICS.length), new Float32Array(HARMONICS));
    for (const { start, length } of burst()) {
      this.#pulse(this.#burst, now + start, length, { frequency: FUNDAMENTAL_HZ, periodicWave: wave }, 1);
    }
    this.#nextBurst = now + burstPeriod();
  }

  #pulse(target, start, length, tone, level) {
    const rise = 0.15 * length;
    const oscillator = new OscillatorNode(this.#context, tone);
    const gain = new GainNode(this.#context, { gain: 0 });
    gain.gain.setValueAtTime(0, start);
    gain.gain.linearRampToValueAtTime(level, start + rise);
    gain.gain.setValueAtTime(level, start + length - rise);
    gain.gain.linearRampToValueAtTime(0, start + length);
    oscillator.connect(gain).connect(target);
    oscillator.start(start);
    oscillator.stop(start + length);
  }
}
