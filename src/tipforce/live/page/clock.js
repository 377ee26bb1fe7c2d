// The engine's clock as this page knows it, from pings. Ages are upper ends: never younger than the truth.

const KEPT_MS = 30_000; // older pings are dropped: clocks drift by about 50 ms in a thousand seconds
const EARLIEST_MS = 20; // rounding, and the drift of the clocks between pings
const TRUSTED_MS = 4_000; // after this time without an answer the engine's clock is not known

export class EngineClock {
  #samples = []; // {at, low, high}: engine time minus page time is between low and high
  #answeredAt = -Infinity; // on the wall clock: the page's own clock stops while the computer sleeps

  /** Takes the answer to a ping. All in ms: sent and received on this page's clock, stamped on the engine's. */
  answered(sentMs, receivedMs, stampedMs, wallMs = Date.now()) {
    const sample = { at: receivedMs, low: stampedMs - receivedMs, high: stampedMs - sentMs };
    const agrees = (other) => sample.low <= other.high + 1 && other.low <= sample.high + 1;
    // A sample that is not consistent with the others: a clock has jumped, and the older samples are no longer true.
    this.#samples = this.#samples.filter((other) => receivedMs - other.at < KEPT_MS);
    this.#samples = this.#samples.every(agrees) ? [...this.#samples, sample] : [sample];
    this.#answeredAt = wallMs;
  }

  forget() {
    this.#samples = [];
  }

  /** The latest that the engine's clock may show now, in ms; NaN while it is not known. */
  latest(nowMs = performance.now(), wallMs = Date.now()) {
    const silent = wallMs - this.#answeredAt;
    if (!this.#samples.length || silent > TRUSTED_MS || silent < -1000) return NaN;
    return nowMs + Math.min(...this.#samples.map((sample) => sample.high));
  }

  /** Largest possible age in ms of an image that was captured then; Infinity while it is not known. */
  age(capturedMs, nowMs = performance.now(), wallMs = Date.now()) {
    const age = this.latest(nowMs, wallMs) - capturedMs;
    return age >= -EARLIEST_MS ? age : Infinity; // an image from the future: the clock is not known
  }
}
