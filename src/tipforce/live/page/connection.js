// The socket to the server: frames in, acknowledgements and commands out; opened again when it is lost.

const FIRST_PINGS_MS = [0, 50, 150, 300];
const PING_MS = 1000;
const RETRY_MS = [250, 500, 1000, 2000];
const REFUSED = 1013; // the code with which the server closes one page too many
const SILENT_MS = 5000; // a socket that answers no ping for this time is dead, also if the browser shows it as open

export class Connection {
  #socket = null;
  #attempts = 0;
  #waiting = new Map(); // id of a command -> function that takes its answer
  #id = 0;
  #heardAt = 0;
  #display = null;
  refused = ""; // reason why the server rejects this page; the page tries again

  /** @param {{frame, state, loop, pong, opened, closed}} on functions to call */
  constructor(on) {
    this.on = on;
    setInterval(() => this.#beat(), PING_MS);
    this.#open();
  }

  get open() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    this.#heardAt = performance.now();
    socket.onopen = () => {
      for (const wait of FIRST_PINGS_MS) setTimeout(() => this.#ping(), wait);
      if (this.#display) this.#send(this.#display);
      this.on.opened();
    };
    socket.onmessage = (event) => {
      this.#heardAt = performance.now();
      this.#attempts = 0; // only now: a server that rejects a page also opens its socket first
      this.refused = "";
      if (typeof event.data === "string") this.#answer(JSON.parse(event.data));
      else this.on.frame(event.data);
    };
    socket.onclose = (event) => {
      if (socket !== this.#socket) return;
      this.#socket = null;
      for (const done of this.#waiting.values()) done({ ok: false, message: "the connection was lost" });
      this.#waiting.clear();
      this.refused = event.code === REFUSED ? `${event.reason}; close one of them. This page tries again by itself` : "";
      this.on.closed();
      const wait = RETRY_MS[Math.min(this.#attempts++, RETRY_MS.length - 1)];
      setTimeout(() => this.#open(), wait);
    };
  }

  #answer(values) {
    if (values.answer === "pong") this.on.pong(values.sent_ms, performance.now(), values.clock_ms);
    else if (values.answer === "state") this.on.state(values);
    else if (values.answer === "loop") this.on.loop(values);
    else if (values.answer === "command") {
      this.#waiting.get(values.id)?.(values);
      this.#waiting.delete(values.id);
    } else console.warn("refused by the server:", values.message);
  }

  #beat() {
    if (!this.open) return;
    if (performance.now() - this.#heardAt > SILENT_MS) {
      const socket = this.#socket;
      socket.close();
      socket.onclose({ reason: "the server does not answer" });
    } else this.#ping();
  }

  #ping() {
    this.#send({ command: "ping", sent_ms: performance.now() });
  }

  #send(values) {
    if (this.open) this.#socket.send(JSON.stringify(values));
  }

  acknowledge(number, ageMs) {
    this.#send({ command: "ack", number, age_ms: Number.isFinite(ageMs) ? ageMs : null });
  }

  display(view, widthPx) {
    const wanted = { command: "display", view, width_px: Math.max(1, Math.round(widthPx)) };
    if (JSON.stringify(wanted) === JSON.stringify(this.#display)) return;
    this.#display = wanted;
    this.#send(wanted);
  }

  /** Sends a command of an operator. @returns {Promise<{ok: boolean, message: string}>} */
  ask(values) {
    if (!this.open) return Promise.resolve({ ok: false, message: "there is no connection" });
    const id = this.#id++;
    return new Promise((done) => {
      this.#waiting.set(id, done);
      this.#send({ ...values, id });
    });
  }
}
