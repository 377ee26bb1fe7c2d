// The live page: takes frames as they come, shows the newest, and never an old one as live.

import { Alarm } from "./alarm.js";
import { EngineClock } from "./clock.js";
import { Connection } from "./connection.js";
import { Controls } from "./controls.js";
import { OLDEST_MS, Veil } from "./freshness.js";
import { drawGauge } from "./gauge.js";
import { holds, judge, passesLimit } from "./judge.js";
import { LoopPanel } from "./loop.js";
import { readMessage } from "./message.js";
import { duration, inGrams, inNewtons, NOTHING, seconds } from "./numbers.js";
import { Scene } from "./scene.js";
import { Sound } from "./sound.js";
import { Trace } from "./trace.js";

const DIGITS_MS = 100; // digits that change more often cannot be read
const TRACE_MS = 33;
const DESCRIBED_MS = 3000; // a screen reader needs time to read what a drawing shows
const TITLE_SHARE = 0.6; // of the strip at most, where there is a detail beside it
const LONG_DETAIL = 45; // letters; more are set smaller
const UNCLEAR_DEG = 45; // an angle that is less certain is not shown

const $ = (id) => document.getElementById(id);
const set = (id, text) => {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
};

const app = {
  alarm: new Alarm(),
  sound: new Sound(),
  state: { contact: { contact_n: 0.01, window_n: [0.1, 0.3], limit_n: 0.4 } },
  update: null,
  verdict: { kind: "waiting", live: false },
  view: "",
};
const clock = new EngineClock();
const scene = new Scene($("video"));
const trace = new Trace();
const veils = Object.fromEntries(
  ["strip", "scene", "force"].map((id) => [id, new Veil($(id).querySelector(".veil"))]),
);
let digits = null; // the update whose digits are shown
let digitsKind = "";
let digitsAt = -Infinity;
let imageAt = -Infinity; // on the engine's clock, when the image that is shown was captured
let traceAt = -Infinity;
let edge = null; // {engineMs, wallMs}: the engine's clock when it was last known
let describedAt = -Infinity;

app.connection = new Connection({
  frame: take,
  state: (state) => {
    if (state.recording_message && state.recording_message !== app.state.recording_message) {
      controls.notice("The recording has stopped: the reason is above the buttons.");
    }
    app.state = state;
  },
  loop: (status) => loop.heard(status),
  pong: (sent, received, stamped) => clock.answered(sent, received, stamped),
  opened: () => present(),
  closed: () => {
    clock.forget();
    present();
  },
});
const controls = new Controls(app);
const loop = new LoopPanel(app, (text) => controls.notice(text));

async function take(buffer) {
  let update;
  try {
    update = readMessage(buffer);
  } catch (error) {
    controls.notice(error.message);
    return;
  }
  try {
    if (update.jpeg) {
      await scene.load(update.jpeg);
      imageAt = update.capturedMs;
    }
  } catch (error) {
    console.warn("the image could not be read:", error);
  }
  app.update = update; // its numbers and its image appear together
  trace.add(update);
  present();
  scene.draw(update.values, digits?.values ?? null, app.state.contact.limit_n);
  app.connection.acknowledge(update.number, clock.age(update.capturedMs));
  app.connection.display(app.view, scene.widthPx);
}

/** Shows what is true now; called with every frame, and often without. */
function present() {
  const { update, state, connection } = app;
  const now = performance.now();
  const age = {
    frame: update ? clock.age(update.capturedMs, now) : Infinity,
    notice: update ? clock.age(update.publishedMs, now) : Infinity,
  };
  const verdict = judge(update, state, connection, age);
  app.verdict = verdict;
  const values = verdict.live ? update.values : null;
  app.alarm.update(values, state.contact.limit_n, now);
  if (app.alarm.on && values && !passesLimit(values, state.contact.limit_n)) verdict.detail = "was above the limit just now";
  document.body.dataset.kind = verdict.kind;
  showAlarm(app.alarm.on ? (app.alarm.held ? "held" : "on") : "off");
  const current = verdict.live || verdict.kind === "invalid";
  set("sign", verdict.sign);
  if ($("title").textContent !== verdict.title || Boolean($("detail").textContent) !== Boolean(verdict.detail)) {
    set("title", verdict.title);
    fitTitle(Boolean(verdict.detail));
  }
  set("detail", verdict.detail);
  $("detail").classList.toggle("long", verdict.detail.length > LONG_DETAIL);
  if (current) veils.strip.hold(holds(verdict, age));
  else veils.strip.fall(verdict.title, verdict.detail, verdict.sign);

  const imageAge = clock.age(imageAt, now);
  const rounded = imageAge < 1000 ? `${Math.round(imageAge)} ms` : seconds(imageAge);
  set("age", Number.isFinite(imageAge) ? rounded : NOTHING);
  if (connection?.open && imageAge <= OLDEST_MS) veils.scene.hold(OLDEST_MS - imageAge);
  else veils.scene.fall(veilTitle(verdict), "", "");

  drawGauge($("gauge"), state.contact, values);
  const old = !digits || now - digitsAt >= DIGITS_MS || clock.age(digits.capturedMs, now) > OLDEST_MS / 2;
  const due = old || verdict.kind !== digitsKind; // strip and number are always consistent
  if (current && (due || !values)) {
    showDigits(values);
    controls.refresh(now); // a number and its zero appear together
    digits = values ? update : null;
    digitsKind = verdict.kind;
    digitsAt = now;
    if (update) scene.draw(update.values, digits?.values ?? null, state.contact.limit_n);
  }
  if (!current) veils.force.fall(veilTitle(verdict), "", "");
  else veils.force.hold(values ? OLDEST_MS - clock.age(digits.capturedMs, now) : holds(verdict, age));

  const paused = app.alarm.pausedFor(now) > 0;
  if (values) app.sound.force(values.magnitude_n, state.contact, OLDEST_MS - age.frame);
  else app.sound.nothing(now);
  app.sound.alarm(app.alarm.on, paused);
}

/** Makes the title of the strip as small as it has to be, so that nothing of it is cut off. */
function fitTitle(hasDetail) {
  const strip = $("strip");
  strip.style.setProperty("--fit", 1);
  const beside = hasDetail && innerWidth > innerHeight; // in portrait format the detail is below
  const spaces = 1.3 * parseFloat(getComputedStyle(strip).fontSize);
  const needed = $("sign").offsetWidth + $("title").offsetWidth + spaces;
  const room = (beside ? TITLE_SHARE : 0.97) * strip.clientWidth;
  strip.style.setProperty("--fit", Math.min(1, room / needed).toFixed(3));
}

function showAlarm(alarm) {
  if (document.body.dataset.alarm === alarm) return;
  document.body.dataset.alarm = alarm;
  for (const element of document.querySelectorAll("#alarm-frame, #strip .flash")) {
    for (const animation of element.getAnimations()) animation.startTime = 0; // strip and border flash together
  }
}

function veilTitle(verdict) {
  return ["disconnected", "refused", "waiting"].includes(verdict.kind) ? verdict.title : "STALE";
}

/** The numbers of a live update; null: there is none. */
function showDigits(values) {
  set("grams", values ? inGrams(values.magnitude_n) : "– –");
  set("newtons", values ? `${inNewtons(values.magnitude_n)} N` : "no valid force");
  $("force").classList.toggle("none", !values);
  const [low, high] = values?.interval_n ?? [null, null];
  const known = low !== null && high !== null;
  set("interval", known ? `${inGrams(low)} – ${inGrams(high)} g` : NOTHING);
  const tip = values?.tip ?? null;
  set("axial", tip ? `${inGrams(tip.axial_n, true)} g` : NOTHING);
  set("axial-n", tip ? `${inNewtons(tip.axial_n)} N` : "");
  set("lateral", tip ? `${inGrams(tip.lateral_n)} g` : NOTHING);
  set("lateral-n", tip ? `${inNewtons(tip.lateral_n)} N` : "");
  showComponents(values);
  const touches = values && values.magnitude_n > app.state.contact.contact_n;
  const clear = touches && tip && tip.angle_deg !== null && (tip.angle_error_deg ?? 0) <= UNCLEAR_DEG;
  set("angle", clear ? `${tip.angle_deg.toFixed(0)}°` : NOTHING);
  const unsure = touches && tip ? "not clear" : "";
  set("angle-error", clear ? (tip.angle_error_deg === null ? "" : `± ${tip.angle_error_deg.toFixed(0)}°`) : unsure);
}

/** The force in space: of a method that knows all three components. */
function showComponents(values) {
  const known = values?.force_n.every((part) => part !== null);
  if (known) $("components").hidden = false; // they stay, so that the page does not jump where a force is not valid
  for (const [k, axis] of ["x", "y", "z"].entries()) {
    set(`force-${axis}`, known ? `${inGrams(values.force_n[k], true)} g` : NOTHING);
    const [low, high] = known ? values.component_intervals_n[k] : [null, null];
    set(`force-${axis}-ends`, low === null ? "" : `${inGrams(low, true)} to ${inGrams(high, true)}`);
  }
}

/** Shows the slowly changing values, also without a force. */
function showSums() {
  const values = app.update?.values;
  const clinical = values?.clinical;
  set("class", clinical ? clinical.contact_class : NOTHING);
  set("share", clinical && clinical.window_share !== null ? `${Math.round(100 * clinical.window_share)} %` : NOTHING);
  set("share-note", clinical ? `of ${duration(clinical.elapsed_s - clinical.unknown_s)} known` : "");
  set("integral", clinical ? `${clinical.integral_g_s.toFixed(0)} g s` : NOTHING);
  const [low, high] = clinical?.integral_interval_g_s ?? [null, null];
  set("integral-note", low === null || high === null ? "" : `${low.toFixed(0)} – ${high.toFixed(0)}`);
  const health = values?.health;
  set("rate", health ? health.frames_per_s.toFixed(0) : NOTHING);
  set("latency", health && health.latency_p50_ms !== null ? `${health.latency_p50_ms.toFixed(0)} ms` : NOTHING);
  const recording = app.state.recording_message ?? "";
  const failing = Object.entries(health?.sinks ?? {}).filter(([, message]) => !recording.includes(message));
  const outputs = failing.map(([name, message]) => `${name}: ${message}`);
  const detail = $("detail"); // the strip shows most of it; the part that does not fit is shown here
  const cut = detail.scrollHeight > detail.clientHeight + 1 ? app.verdict.detail : "";
  const trouble = health?.message === values?.detail ? "" : health?.message;
  const warning = [recording, cut, trouble, ...outputs].filter(Boolean).join(" · ");
  set("session", [app.state.session, app.state.model].filter(Boolean).join(" · "));
  $("warning").hidden = !warning;
  if (warning) set("warning", `⚠ ${warning}`);
  $("simulated").hidden = !app.state.simulated;
  const views = values?.views ?? [];
  $("view-name").hidden = views.length < 2 || !values.view;
  set("view-name", values?.read.includes(values.view) ? values.view : `${values?.view}, not read`);
}

function tick() {
  present();
  showSums();
  controls.refresh(performance.now());
  loop.refresh(performance.now());
  describe(performance.now());
}

function drawTrace(now) {
  if (now - traceAt >= TRACE_MS) {
    traceAt = now;
    const latest = clock.latest();
    if (!Number.isNaN(latest)) edge = { engineMs: latest, wallMs: Date.now() };
    trace.draw($("trace"), app.state.contact, edgeMs());
  }
  requestAnimationFrame(drawTrace);
}

/** The engine's clock at the right edge of the trace; it goes on when the server is lost. */
function edgeMs() {
  return edge ? edge.engineMs + Date.now() - edge.wallMs : (app.update?.capturedMs ?? 0);
}

/** Describes the drawings for a screen reader. */
function describe(now) {
  if (now - describedAt < DESCRIBED_MS) return;
  describedAt = now;
  const { verdict, state, update } = app;
  const label = (id, text) => $(id).setAttribute("aria-label", text);
  const force = verdict.live && digits ? digits.values : null;
  const [low, high] = force?.interval_n ?? [null, null];
  const interval = low === null || high === null ? "" : `, 90 % interval ${inGrams(low)} to ${inGrams(high)} g`;
  const text = force ? `Force ${inGrams(force.magnitude_n)} g${interval}` : `No force is shown: ${verdict.title}`;
  const { window_n: window, limit_n: limit } = state.contact;
  label("gauge", `${text}; window ${window.map((end) => inGrams(end)).join(" to ")} g, limit ${inGrams(limit)} g`);
  const found = update?.values.shape ? "the catheter is detected" : "no catheter is detected";
  label("video", update?.values.size ? `Camera image, ${found}. ${text}` : "no image");
  label("trace", trace.described(edgeMs()));
}

/** Tablets dim their display; where the browser lets it, this page keeps it lit. */
async function stayLit() {
  if (document.visibilityState !== "visible" || !navigator.wakeLock) return;
  try {
    await navigator.wakeLock.request("screen");
  } catch (error) {
    console.info("the display may dim:", error.message);
  }
}

new ResizeObserver(() => {
  fitTitle(Boolean($("detail").textContent));
  scene.redraw();
  app.connection.display(app.view, scene.widthPx);
}).observe($("scene"));
document.addEventListener("visibilitychange", stayLit);
stayLit();
setInterval(tick, DIGITS_MS);
requestAnimationFrame(drawTrace);
