"""``tipforce record``."""

import math
import signal
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .._system.processes import ending_signals
from ._common import JsonOption, check_outputs, console, say, write_json
from ._facts import BenchOption, FactOption, offset_from, tare_from

if TYPE_CHECKING:
    from rich.table import Table

    from ..pipelines import BenchRecording

_LINE_EVERY_S = 5.0


def command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The recording (.mcap).")],
    bench: BenchOption = None,
    simulated: Annotated[
        str | None, typer.Option(metavar="PRESET", help="A simulated bench in real time, in place of devices.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="How long; else until Ctrl-C.")] = None,
    guided: Annotated[
        bool, typer.Option("--guided", help="A first session with instructions (tare, move, press) and a check.")
    ] = False,
    partial: Annotated[bool, typer.Option("--partial", help="Record also where a device does not answer.")] = False,
    fact: FactOption = None,
    tare: Annotated[
        str, typer.Option(help="Contact-free stretch START:END in seconds of the force; auto: found; none.")
    ] = "auto",
    offset_ms: Annotated[
        str, typer.Option(help="Camera clock minus force clock; auto: from the deflection; none: as stamped.")
    ] = "auto",
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep images as PNG, about ten times larger.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a recording that is there already.")] = False,
    json: JsonOption = None,
) -> None:
    """Record all devices of a bench into one file: images, force, stage and knob on one clock.

    The bench.toml describes the devices under [hardware]; see docs/hardware.md. It shows connections, rates,
    drops and clock offsets. Ctrl-C ends it; events are written as they come, and tare and clock map found at the
    end. After a kill or on a full disk all but the last second is kept in FILE.part.

    Example:
        tipforce record --bench bench.toml -o runs/monday.mcap

        tipforce record --bench bench.toml --guided -o first.mcap

        tipforce record --simulated bench-2021 --seconds 20 -o simulated.mcap
    """
    from ..errors import InputError
    from ..pipelines import BenchRecording, Guide, describe_recording
    from ..types import SessionInfo, info_from_facts

    check_outputs([], output, json)
    offset = offset_from(offset_ms)
    if offset == "start":
        raise InputError("--offset-ms start: goes with the logs of tipforce import only")
    stated = info_from_facts(fact) if fact else SessionInfo()
    guide = Guide() if guided else None
    recording = BenchRecording(bench, simulated=simulated, stated=stated, seconds=seconds, guide=guide, partial=partial)
    with _stopped_by_signals(recording.stop):
        for line in recording.connect():
            say(line, "yellow")
        with _shown_live(recording):
            done = recording.run(output, tare=tare_from(tare), offset_ms=offset, lossless=lossless, overwrite=overwrite)
    for line in (*describe_recording(done.summary), *done.remarks):
        say(line)
    write_json(done.summary.figures() | {"remarks": list(done.remarks)}, json)


@contextmanager
def _stopped_by_signals(stop: Callable[[], None]) -> Generator[None]:
    """Calls ``stop`` at the first Ctrl-C, SIGTERM or SIGHUP, so that the recording is completed and kept.

    A second Ctrl-C or SIGTERM ends the program. Outside the main thread signals are not handled.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in ending_signals()}

    def stop_once(number: int, frame: Any) -> None:
        del number, frame
        for ending, handler in before.items():  # a terminal that is closed sends SIGHUP twice
            signal.signal(ending, signal.SIG_IGN if ending.name == "SIGHUP" else handler)
        stop()

    for ending in before:
        signal.signal(ending, stop_once)
    try:
        yield
    finally:
        for ending, handler in before.items():
            signal.signal(ending, handler)


@contextmanager
def _shown_live(recording: "BenchRecording") -> Generator[None]:
    """Shows a table that is drawn anew on a terminal; a line every few seconds elsewhere."""
    with ExitStack() as stack:
        if console.is_terminal:
            from rich.live import Live

            stack.enter_context(
                Live(get_renderable=lambda: _table(recording), console=console, refresh_per_second=4, transient=True)
            )
        else:
            over = threading.Event()
            thread = threading.Thread(target=_lines, args=(recording, over), daemon=True)
            stack.callback(thread.join)
            stack.callback(over.set)
            thread.start()
        yield


def _lines(recording: "BenchRecording", over: threading.Event) -> None:
    """Prints rates, faults and the guide's request every few seconds until ``over`` is set; for a log."""
    while not over.wait(_LINE_EVERY_S):
        rates = [
            f"{stream.stream.name} {stream.live_rate_hz:.1f} Hz"
            + (f" ({stream.dropped} dropped)" * bool(stream.dropped))
            for device in recording.health()
            for stream in device.streams
        ]
        trouble = "".join(f"; {device.name}: {device.message}" for device in recording.health() if device.message)
        guide = f"; {recording.guide.prompt()}" if recording.guide else ""
        say(f"{recording.seconds_so_far():.0f} s: {', '.join(rates) or 'nothing yet'}{trouble}{guide}")


def _table(recording: "BenchRecording") -> "Table":
    """Returns a table with a row for each stream of each device, and messages and the guide's request below it."""
    from rich.table import Table

    title = f"recording, {recording.seconds_so_far():.0f} s; Ctrl-C ends it"
    table = Table(title=title, title_justify="left", caption_justify="left")
    for column in ("device", "state", "stream", "rate", "readings", "dropped", "age", "clock offset", "counts"):
        table.add_column(column)
    for device in recording.health():
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(device.counts.items()) if count)
        for stream in device.streams:
            stated_hz, clock = stream.stream.rate_hz, stream.clock
            on_arrival = math.isnan(clock.offset_s)  # the device stamps nothing itself
            offset = f"{clock.offset_s:+.4f} s, delay {1e3 * clock.delay_s:.2f} ms"
            table.add_row(
                device.name,
                device.state,
                stream.stream.name,
                f"{stream.live_rate_hz:.1f}" + (f" of {stated_hz:g} Hz" if stated_hz else " Hz"),
                str(stream.count),
                str(stream.dropped),
                "" if math.isnan(stream.age_s) else f"{1e3 * stream.age_s:.0f} ms",
                "on arrival" if on_arrival else offset,
                counts,
            )
    lines = [device.message for device in recording.health() if device.message]
    if recording.guide:
        lines.insert(0, recording.guide.prompt())
    table.caption = "\n".join(lines)
    return table
