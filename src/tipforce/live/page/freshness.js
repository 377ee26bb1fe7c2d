// Old values disappear by themselves. A veil with the word STALE covers everything that is shown as live; each new
// frame pushes it back for as long as the frame stays young. The browser's compositor moves it, not this script: it
// falls in time even while the script is held up.

export const OLDEST_MS = 300;
const FALL_MS = 20;

export class Veil {
  #animation;
  #detail;
  #title;
  #sign;

  /** @param {HTMLElement} element the veil; it holds .veil-title and may hold .veil-detail and .veil-sign */
  constructor(element) {
    this.#title = element.querySelector(".veil-title");
    this.#detail = element.querySelector(".veil-detail");
    this.#sign = element.querySelector(".veil-sign");
    const total = OLDEST_MS + FALL_MS;
    this.#animation = element.animate(
      [
        { opacity: 0, offset: 0 },
        { opacity: 0, offset: OLDEST_MS / total },
        { opacity: 1, offset: 1 },
      ],
      { duration: total, fill: "both" },
    );
    this.fall("CONNECTING", "", "…");
  }

  /** Keeps the veil away for this time, in ms. */
  hold(remainingMs) {
    this.#say("STALE", "", "✕");
    this.#animation.currentTime = OLDEST_MS - remainingMs;
    if (this.#animation.playState !== "running") this.#animation.play();
  }

  /** Lets the veil fall now, and shows the reason. */
  fall(title, detail, sign) {
    this.#say(title, detail, sign);
    if (this.#animation.playState !== "finished") this.#animation.finish();
  }

  #say(title, detail, sign) {
    for (const [element, text] of [[this.#title, title], [this.#detail, detail], [this.#sign, sign]]) {
      if (element && element.textContent !== text) element.textContent = text;
    }
  }
}
