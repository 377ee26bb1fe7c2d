"""Serves one open page: sends frames, one at a time, and executes its commands."""

import asyncio
import json
import logging
import time
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from ...clinical import ContactSettings
from ...errors import InputError, TipforceError, ZeroInContactError
from ._commands import (
    MAX_COMMAND_BYTES,
    Acknowledge,
    Command,
    Display,
    Integral,
    Limits,
    Loop,
    Ping,
    Record,
    UndoZero,
    ZeroForce,
    read_command,
)
from ._hub import Hub
from ._messages import WIDTHS, EncodedUpdate
from ._settings import Commands

_log = logging.getLogger(__name__)

MAX_WAITING_COMMANDS = 4
"""Largest number of commands of one page that may wait for the engine at the same time."""
MAX_WAITING_ANSWERS = 16
"""Largest number of answers that may wait for a socket; a page that does not read them gets no more."""
LOOP_CHANGED_S, LOOP_UNCHANGED_S = 0.1, 0.5
"""Interval at which the state of the loop is sent if it changes, and if it does not change."""
_Order = ZeroForce | UndoZero | Integral | Record | Limits | Loop
"""Commands of an operator, each of which gets an answer."""
_GOING_AWAY = 1001
_BAD_DATA = 1003


class PageSession:
    """Serves one page.

    A frame is sent only after the page has acknowledged the one before it: a socket alone does not show that the
    browser is slow, and frames that it has not drawn yet would become old in the buffers between.

    Args:
        socket: the page's socket.
        hub: state that all pages share.
    """

    def __init__(self, socket: WebSocket, hub: Hub) -> None:
        self._socket, self._hub = socket, hub
        where = "" if socket.client is None else f" at {socket.client.host}"
        self._name = f"page {hub.next_name()}{where}"
        """Name of the page that pressed a button, for all other pages and streams."""
        self._sending = asyncio.Lock()
        """Held while a message is sent: tasks of their own send frames, states and answers."""
        self._view, self._width = "", WIDTHS[2]
        self._in_flight: int | None = None
        """Number of the frame that was sent and not acknowledged; None if the next one may be sent."""
        self._orders: set[asyncio.Task[None]] = set()
        """Commands of the page that are being executed, without stops."""
        self._stops: set[asyncio.Task[None]] = set()
        """Stop commands of the page that are being executed."""
        self._answers: set[asyncio.Task[None]] = set()
        """Answers that are being sent."""

    async def run(self) -> None:
        """Serves the page until the page closes its socket or the server ends.

        Three tasks run at the same time; the first that ends, or fails, ends the session. Then all tasks of the page
        are cancelled but its stop commands: these are executed also when the page has gone.
        """
        await self._socket.accept()
        self._news = self._hub.join()  # set by the hub when there is a new frame or state
        serving = [asyncio.create_task(each) for each in (self._send_news(), self._receive(), self._send_loop())]
        try:
            ended, _ = await asyncio.wait(serving, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                task.result()  # raises the error of a task that failed
        except (WebSocketDisconnect, OSError):
            pass  # the page has gone, which is no error
        finally:
            self._hub.leave(self._news)
            cancelled = [*serving, *self._orders, *self._answers]
            for task in cancelled:
                task.cancel()
            await asyncio.gather(*cancelled, return_exceptions=True)

    async def _send_news(self) -> None:
        """Sends the state of the engine when it changes, and the newest frame once the page has drawn the last one."""
        state, last = None, -1
        while not self._hub.closing:
            await self._news.wait()
            self._news.clear()
            if self._hub.state is not state:
                state = self._hub.state
                await self._send_text(state.text())
            newest = self._hub.newest
            if newest is not None and newest.number != last and self._in_flight is None:
                last = newest.number
                await self._send_frame(newest)
        async with self._sending:
            await self._socket.close(_GOING_AWAY, "the server has ended")

    async def _send_loop(self) -> None:
        """Sends the state of the loop independently of the frames, so that it is sent also when those stop."""
        last, sent_s = "", 0.0
        while True:  # until `run` ends
            loop = self._hub.settings.loop
            text = "" if loop is None else loop.status.text()
            if text and (text != last or time.monotonic() - sent_s >= LOOP_UNCHANGED_S):
                last, sent_s = text, time.monotonic()
                await self._send_text(text)
            await asyncio.sleep(LOOP_CHANGED_S)

    async def _send_frame(self, encoded: EncodedUpdate) -> None:
        message = await asyncio.to_thread(encoded.message, self._view, self._width)
        self._in_flight = encoded.number & 0xFFFFFFFF
        self._hub.latencies_s.append((self._hub.settings.clock.now_ns() - encoded.update.captured_ns) * 1e-9)
        async with self._sending:
            await self._socket.send_bytes(message)

    async def _send_text(self, text: str) -> None:
        async with self._sending:
            if self._socket.application_state is WebSocketState.CONNECTED:  # this side has not closed it yet
                await self._socket.send_text(text)

    async def _receive(self) -> None:
        """Reads the commands of the page until it disconnects; a text that is no command gets a refusal.

        A message that is not text, or is too long, does not come from our page: the socket is closed.
        """
        while True:
            received = await self._socket.receive()
            if received["type"] == "websocket.disconnect":
                return
            self._hub.heard()
            text = received.get("text")
            if text is None or len(text) > MAX_COMMAND_BYTES:
                await self._socket.close(_BAD_DATA, "commands are short JSON texts")
                return
            try:
                command = read_command(text)
            except InputError as error:
                self._say({"answer": "refused", "message": str(error)})
                continue
            self._take(command)

    def _say(self, values: dict[str, Any]) -> None:
        """Answers without waiting: a socket that does not read must not delay a stop."""
        if len(self._answers) < MAX_WAITING_ANSWERS:
            self._keep(asyncio.create_task(self._send_text(json.dumps(values))), self._answers)

    @staticmethod
    def _keep(task: asyncio.Task[None], tasks: set[asyncio.Task[None]]) -> None:
        def done(ended: asyncio.Task[None]) -> None:
            tasks.discard(ended)
            if not ended.cancelled():
                ended.exception()  # the page has gone

        tasks.add(task)
        task.add_done_callback(done)

    def _take(self, command: Command) -> None:
        """Begins to execute a command, without waiting for its end; a stop has threads of its own."""
        match command:
            case Acknowledge():
                if command.number == self._in_flight:
                    self._in_flight = None
                    if command.age_ms is not None:
                        self._hub.page_ages_s.append(command.age_ms * 1e-3)
                    self._news.set()
            case Ping():
                now_ms = self._hub.settings.clock.now_ns() * 1e-6
                self._say({"answer": "pong", "sent_ms": command.sent_ms, "clock_ms": round(now_ms, 4)})
            case Display():
                self._view, self._width = command.view, command.width_px
            case Loop(do="stop"):
                self._begin(command, self._stops, self._hub.urgent)
            case ZeroForce() | UndoZero() | Integral() | Record() | Limits() | Loop():
                self._begin(command, self._orders, None)

    def _begin(self, command: _Order, waiting: set[asyncio.Task[None]], on: Executor | None) -> None:
        if len(waiting) >= MAX_WAITING_COMMANDS:
            self._say(_answer(command.id, "still busy with the commands before"))
            return
        self._keep(asyncio.create_task(self._execute(command, on)), waiting)

    async def _execute(self, command: _Order, on: Executor | None) -> None:
        """Executes a command on another thread, so that frames and pings continue meanwhile; then answers the page."""
        _log.info("from a page: %s", command)
        try:
            await asyncio.get_running_loop().run_in_executor(on, self._job(command))
        except ZeroInContactError as error:
            self._say(_answer(command.id, str(error)) | {"confirm_n": error.magnitude_n})
            return
        except TipforceError as error:
            refusal = str(error)
        except Exception:
            _log.exception("%s failed", command)
            refusal = "failed; the program's log says why"
        else:
            refusal = ""
        self._say(_answer(command.id, refusal))

    def _job(self, command: _Order) -> Callable[[], None]:
        """Returns the function that executes a command. Raises InputError before the run has begun."""
        buttons = self._buttons
        match command:
            case ZeroForce():
                return lambda: buttons.zero(by=self._name, confirmed_n=command.confirmed_n)
            case UndoZero():
                return buttons.clear_zero
            case Integral():
                return buttons.start_integral if command.on else buttons.stop_integral
            case Record():
                return lambda: self._record(command.on)
            case Limits():
                return lambda: self._set_limits(command)
            case Loop():
                return lambda: self._order(command)

    @property
    def _buttons(self) -> Commands:
        if self._hub.commands is None:
            raise InputError("the run has not begun yet")
        return self._hub.commands

    def _order(self, command: Loop) -> None:
        loop = self._hub.settings.loop
        if loop is None:
            raise InputError("no force is held in this run")
        getattr(loop, command.do)()

    def _record(self, on: bool) -> None:
        """Starts or stops the recording, and shows that on all pages. Raises InputError if nothing can be recorded."""
        switch = self._hub.settings.on_record
        if switch is None:
            raise InputError("nothing can be recorded in this run")
        if on:  # set before the switch, so that the state that the recording itself reports comes last
            self._hub.change(recording=True, recording_message="")
        try:
            switch(on)
        except TipforceError as error:
            self._hub.change(recording=False, recording_message=str(error))
            raise
        if not on:
            self._hub.change(recording=False, recording_message="")

    def _set_limits(self, command: Limits) -> None:
        """Sets force window and limit for the engine and all pages. Raises InputError if they are not plausible."""
        set_contact = self._hub.settings.on_contact
        if set_contact is None:
            raise InputError("window and limit cannot be set in this run")
        with self._hub.limits:
            before = self._hub.state.contact
            try:
                contact = ContactSettings.model_validate(
                    before.model_dump() | {"window_n": command.window_n, "limit_n": command.limit_n}
                )
            except ValueError as error:
                raise InputError(_first_line(error)) from None
            set_contact(contact)
            self._hub.change(contact=contact)


def _answer(number: int, refusal: str) -> dict[str, Any]:
    return {"answer": "command", "id": number, "ok": not refusal, "message": refusal}


def _first_line(error: ValueError) -> str:
    """Returns the first finding of pydantic, without the value and the address of its manual."""
    lines = [line.strip() for line in str(error).splitlines()]
    return lines[-2].partition(" [")[0].removeprefix("Value error, ") if len(lines) > 2 else lines[0]
