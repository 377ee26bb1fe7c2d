"""The process that runs cases, one after the other: the parent watches it, and starts another where it dies.

``python -m tests.fuzz.worker CORPUS`` reads lines ``TARGET SEED CASE`` and answers each with a line of JSON. ``calm``
in place of a case's number runs the target's commands on good input: what is compiled or loaded once is so before a
case's time counts.
"""

import contextlib
import faulthandler
import io
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

from .spoil import Spoiler  # type: ignore[import-not-found]
from .targets import TARGETS, Case, Make  # type: ignore[import-not-found]

MOST_SAID = 600
"""Characters of a refusal."""
MOST_ROOM = 6 << 30
"""Bytes of address space beyond what the process has when it begins: what asks for more is refused by the system."""
_STATUS = Path("/proc/self/status")


def _kib(field: str) -> int:
    return next(int(line.split()[1]) for line in _STATUS.read_text().splitlines() if line.startswith(field))


def _limit_room() -> None:
    most = 1024 * _kib("VmSize:") + MOST_ROOM
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def make_of(target: str, case: int) -> Make:
    """The command that the case's number stands for."""
    makes = TARGETS[target]
    return makes[case % len(makes)]


def run_words(case: Case) -> tuple[str, str]:
    """Runs a command line in this process; returns the outcome, and what it said or where it failed."""
    from tipforce import cli

    said = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace", write_through=True)
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
    sys.argv = ["tipforce", *case.words]
    code: Any = 0
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            cli.main()
    except SystemExit as stop:
        code = stop.code
    except MemoryError:
        return "memory", traceback.format_exc()
    except BaseException:
        return "traceback", traceback.format_exc()
    text = said.buffer.getvalue().decode("utf-8", "replace").rstrip("\n")  # type: ignore[attr-defined]
    if code in (0, None):
        return "ok", text
    if code != 2:
        return "traceback", f"exit code {code}: {text}"
    wrong = _wrong_with(text, case.names)
    return ("unclear", f"{wrong}: {text}") if wrong else ("refused", text)


def _wrong_with(text: str, names: tuple[str, ...]) -> str:
    """Why a refusal is none that helps, or nothing."""
    if text.startswith("Usage:"):  # the parser of the command line says which option, in its own way
        return ""
    lines = text.split("\n")  # warnings come before
    last = lines[-1]
    if not all(line.startswith("tipforce:") for line in lines):
        return "not one line"
    if len(last) > MOST_SAID:
        return f"{len(last)} characters"
    if any(not (letter.isprintable()) for letter in last):
        return "control characters"
    if not any(name in last for name in names):
        return f"names none of {', '.join(names)}"
    return ""


def run_case(make: Make, spoiler: Spoiler, corpus: Path, keep: Path | None = None) -> dict[str, Any]:
    """Makes a case in a folder of its own and runs it there."""
    folder = keep or Path(tempfile.mkdtemp(prefix="case"))
    folder.mkdir(parents=True, exist_ok=True)
    here = Path.cwd()
    try:
        os.chdir(folder)
        case = make(spoiler, corpus, folder)
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
        before, began = _kib("VmRSS:"), time.monotonic()
        outcome, said = run_words(case)
        seconds, more = time.monotonic() - began, (_kib("VmHWM:") - before) // 1024
        if outcome == "refused" and case.refused:
            outcome = "ok"
        return {"outcome": outcome, "said": said, "seconds": seconds, "mib": more, "words": case.words}
    finally:
        os.chdir(here)
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Answers until its input ends."""
    corpus = Path(sys.argv[1])
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print in C goes where their errors go
    faulthandler.enable()
    import typer.main

    from tipforce import cli

    cli.app = typer.main.get_command(cli.app)  # made once here, and not for every case: half of the time of a refusal
    _limit_room()
    for line in sys.stdin:
        target, seed, number = line.split()
        if number == "calm":
            found = [run_case(make, Spoiler("0", calm=True), corpus) for make in dict.fromkeys(TARGETS[target])]
            bad = [each for each in found if each["outcome"] != "ok"]
            answer = bad[0] if bad else {"outcome": "ok", "said": "", "seconds": 0.0, "mib": 0, "words": ()}
        else:
            spoiler = Spoiler(f"{target} {seed} {number}")
            answer = run_case(make_of(target, int(number)), spoiler, corpus)
        answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
