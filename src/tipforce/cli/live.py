"""``tipforce live``: the force while it happens, on a page, on the terminal and to other programs."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._common import JsonOption, check_outputs, console, say, shown, write_json
from ._facts import BenchOption, FactOption, KnobOption, ViewOption, stated_info
from ._settings import SetOption, settings_from

if TYPE_CHECKING:
    from ..live import LiveReport, LiveUpdate

_LINE_EVERY_S = 10.0
"""Where nobody looks at a terminal, as in a log, there is a line this often."""


def command(
    model: Annotated[Path, typer.Argument(help="A model folder of `tipforce train`, pretrained/NAME, fusion or rod.")],
    frames: Annotated[
        Path | None, typer.Argument(metavar="[VIDEO|FOLDER|RUN.MCAP]", help="A file, played as if it happened now.")
    ] = None,
    simulated: Annotated[
        str | None, typer.Option(metavar="PRESET", help="A simulated bench in real time; see `tipforce simulate`.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address that the page listens on; another one than 127.0.0.1 asks for a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes any that is free.")] = 8770,
    no_page: Annotated[bool, typer.Option("--no-page", help="No page.")] = False,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help="Also a recording of the estimates and their images.")
    ] = None,
    out: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="Also to another program, e.g. igtl://HOST:18944; may be repeated."),
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="End after so long.")] = None,
    bench: BenchOption = None,
    fact: FactOption = None,
    knob_deg: KnobOption = None,
    view: ViewOption = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Estimate the force while it happens: newest image first, and NOT VALID with the reason where there is no force.

    The source is a file played at its own pace, with --simulated a bench that does not exist, and without either the
    devices that bench.toml describes. Ctrl-C ends it.

    --set changes rate_hz and loop of a file, seed of the simulated bench, contact.window_n, contact.limit_n, and how
    long a value counts (stale_s). docs/live.md explains each reason of NOT VALID; docs/streams.md the outputs. The
    window of 0.1 to 0.3 N is the thesis's, the limit of 0.4 N, of alarm and loop, this program's.

    --set hold.target_n=0.2 gives the page a panel from which a loop that holds a force with the drives of the bench is
    started, stopped and retracted; hold.drives, hold.start, hold.goal and all settings of the control are in
    docs/control.md. Nothing moves before it is started there.

    Example:
        tipforce live pretrained/compact --simulated bench-2021 --seconds 20

        tipforce live pretrained/compact video.mp4 --bench bench.toml --no-page --set rate_hz=60

        tipforce live fusion --bench bench.toml --record run.mcap

        tipforce live pretrained/compact --simulated bench-2021 --set hold.target_n=0.2 --set hold.drives=both
    """
    from ..estimators import load_model
    from ..pipelines import LivePage, LiveRunSettings, PageAddress, live, live_line, open_live_source

    check_outputs([] if frames is None else [frames], json_file, record)
    chosen = settings_from(LiveRunSettings, settings)
    facts = stated_info(bench, fact, knob_deg)
    line, recording = _Line(), f"recording:{record}"

    def update(latest: "LiveUpdate") -> None:
        line.show(live_line(latest))

    def report(run: "LiveReport") -> None:
        line.end()
        say(run.text())
        write_json(run.figures(), json_file)
        failed = run.sinks[recording].failures if recording in run.sinks else 0
        if record is not None and not failed and record.exists():
            say(f"wrote {record}")

    with ExitStack() as stack:
        page = None if no_page else stack.enter_context(LivePage(PageAddress(host, port)))

        def starting(doing: str) -> None:
            say(f"starting: {doing}")
            if page is not None:
                page.show_starting(doing)

        if page is not None:
            say(f"page: {page.address}")
        starting(f"loading {model}")
        estimator = load_model(model, view)
        if simulated is not None:
            starting(f"drawing a session of {simulated}, which takes up to a minute")
        elif frames is not None:
            starting(f"opening {frames}")
        else:
            starting("opening the devices")
        source = stack.enter_context(
            open_live_source(frames, preset=simulated, bench=bench, stated=facts, settings=chosen)
        )
        run_report = live(
            estimator,
            source,
            model=str(model),
            outputs=[*(out or ()), *([] if record is None else [recording])],
            page=page,
            settings=chosen,
            seconds=seconds,
            on_update=update,
            on_report=report,
        )
    if any(sink.ended for sink in run_report.sinks.values()):
        raise typer.Exit(2)


class _Line:
    """One line that changes on a terminal; elsewhere a line now and then."""

    def __init__(self) -> None:
        self._shown = False
        self._next_s = time.monotonic()

    def show(self, text: str) -> None:
        """Shows the newest line."""
        if console.is_terminal:
            console.print(shown(text)[: console.width - 1].ljust(console.width - 1), end="\r", soft_wrap=True)
            self._shown = True
        elif time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + _LINE_EVERY_S
            say(text)

    def end(self) -> None:
        """Ends the line, so that later text begins on a line of its own."""
        if self._shown:
            console.print()
