// Judges an update: the title of the strip. Pure functions, without a page.

import { OLDEST_MS } from "./freshness.js";
import { seconds } from "./numbers.js";

const NOTICE_MS = 1000; // a reason for "not valid" is shown for this time after it was published

const REASONS = {
  no_catheter: "no catheter",
  cut_off: "catheter cut off",
  not_a_function: "shape not described",
  missing_input: "missing input",
  out_of_distribution: "unlike the training images",
  unobservable: "shape does not show the force",
  fold: "catheter folds",
  stale: "no new image",
};

const KINDS = {
  no_contact: ["○", "NO CONTACT", ""],
  too_light: ["▼", "TOO LIGHT", "below the window"],
  in_window: ["●", "IN WINDOW", ""],
  above_window: ["▲", "ABOVE WINDOW", "below the limit"],
  may_be_too_hard: ["▲", "MAY BE TOO HARD", "the interval passes the limit"],
  too_hard: ["▲", "TOO HARD", "above the limit"],
};

/** Whether the upper end of the interval passes the limit; without an interval the estimate itself decides. */
export function passesLimit(values, limitN) {
  return (values.interval_n[1] ?? values.magnitude_n) > limitN;
}

function kindOf(values, contact) {
  const force = values.magnitude_n;
  if (force > contact.limit_n) return "too_hard";
  if (passesLimit(values, contact.limit_n)) return "may_be_too_hard";
  if (force > contact.window_n[1]) return "above_window";
  if (force >= contact.window_n[0]) return "in_window";
  return force > contact.contact_n ? "too_light" : "no_contact";
}

/**
 * @param {object|null} update the newest one, as readMessage gives it
 * @param {object} state state that all pages show: window and limit, work of the program before the run begins
 * @param {{open: boolean, refused: string}} connection refused: why the server takes no page, else empty
 * @param {{frame: number, notice: number}} age ms since capture and since publication
 * @returns {{kind: string, sign: string, title: string, detail: string, live: boolean}} live: numbers may be shown
 */
export function judge(update, state, connection, age) {
  const dead = (kind, sign, title, detail) => ({ kind, sign, title, detail, live: false });
  if (connection?.refused) return dead("refused", "✕", "TOO MANY PAGES", connection.refused);
  if (!connection?.open) return dead("disconnected", "✕", "DISCONNECTED", "trying to reach the server again");
  if (state.starting) return dead("waiting", "…", "STARTING", state.starting);
  if (!update) return dead("waiting", "…", "WAITING", "for the first frame");
  const { values } = update;
  const starting = values.health.starting && ["waiting", "running"].includes(values.health.camera);
  if (starting && age.notice <= NOTICE_MS) return dead("waiting", "…", "STARTING", values.detail);
  if (values.status !== "valid" && age.notice <= NOTICE_MS) {
    const late = values.status === "stale" && values.health.camera === "running"; // images come, and no estimates
    const reason = late ? "no new estimate" : (REASONS[values.status] ?? values.status.replaceAll("_", " "));
    return dead("invalid", "✕", `NOT VALID: ${reason}`, values.detail);
  }
  if (!(age.frame <= OLDEST_MS) || values.status !== "valid") {
    const detail = Number.isFinite(age.frame) ? `the newest frame is ${seconds(age.frame)} old` : "age not known";
    return dead("stale", "✕", "STALE", detail);
  }
  const kind = kindOf(values, state.contact);
  const [sign, title, meaning] = KINDS[kind];
  return { kind, sign, title, detail: [meaning, values.detail].filter(Boolean).join(" · "), live: true };
}

/** Time in ms for which the result of `judge` stays true if nothing more arrives. */
export function holds(verdict, age) {
  return verdict.kind === "invalid" ? NOTICE_MS - age.notice : OLDEST_MS - age.frame;
}
