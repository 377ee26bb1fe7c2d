"""Compilation is logged while it goes on, and a user of the command line sees it."""

import logging

import pytest

from tipforce import cli
from tipforce._system import compilation


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that `compilation` reads, as the only element of a list."""
    now = [100.0]
    monkeypatch.setattr(compilation.time, "monotonic", lambda: now[0])
    return now


def compile_one(listener: compilation._CompilationLog, clock: list[float], seconds: float) -> None:
    """A function of ``seconds`` that calls another, which is compiled inside its own compilation."""
    listener.on_start(None)
    clock[0] += seconds / 2
    listener.on_start(None)
    clock[0] += seconds / 2
    listener.on_end(None)
    listener.on_end(None)


def test_compilation_is_logged_after_a_second_and_then_every_five(
    clock: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "tipforce.compilation")
    listener = compilation._CompilationLog()
    for _ in range(7):
        compile_one(listener, clock, 2.0)
    said = [record.getMessage() for record in caplog.records]
    start = "compiling for this processor, once after an installation: "
    assert said == [f"{start}{done}" for done in ("0 functions in 1 s", "3 functions in 6 s", "5 functions in 11 s")]


def test_a_short_compilation_is_not_logged(clock: list[float], caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "tipforce.compilation")
    compile_one(compilation._CompilationLog(), clock, 0.5)
    assert not caplog.records


def test_the_command_line_says_what_is_logged(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = logging.getLogger("tipforce.compilation")
    monkeypatch.setattr(log, "handlers", [])
    monkeypatch.setattr(log, "level", log.level)
    monkeypatch.setattr(cli, "app", lambda: log.info("compiling: 3 functions"))
    monkeypatch.setattr(cli.warnings, "showwarning", cli.warnings.showwarning)
    cli.main()
    assert "compiling: 3 functions" in capsys.readouterr().err
