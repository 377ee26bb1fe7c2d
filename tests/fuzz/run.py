"""Runs many cases in processes that are watched, and counts how they ended."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

__all__ = ["OUTCOMES", "Failure", "Run", "Worker", "fuzz", "table"]

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 10.0
"""A case that takes longer hangs."""
CALM_S = 600.0
"""The first time a command is run, its loops are compiled."""
LIMIT_MIB = 1024
"""More than the process had before the case."""
OUTCOMES = ("ok", "refused", "unclear", "traceback", "signal", "hang", "memory")
"""`ok` and `refused` are how a command may end; `unclear`: refused, but not in one short line that names the input."""


@dataclass(frozen=True)
class Failure:
    """A case that ended as none may."""

    target: str
    seed: int
    case: int
    outcome: str
    said: str

    @property
    def again(self) -> str:
        """The command that shows it."""
        return f"python -m tests.fuzz {self.target} --seed {self.seed} --case {self.case}"

    @property
    def last(self) -> str:
        """One line of what it said."""
        lines = [line for line in self.said.strip().splitlines() if line.strip()]
        return (lines[-1] if lines else "")[:300]


@dataclass
class Run:
    """What was counted of one target."""

    target: str
    outcomes: Counter[str] = field(default_factory=Counter[str])
    failures: list[Failure] = field(default_factory=list[Failure])
    seconds: float = 0.0
    slowest: float = 0.0
    largest: int = 0


class Worker:
    """One process that runs cases; it is started when it is needed, and again after it died."""

    def __init__(self, corpus: Path) -> None:
        self.command = [sys.executable, "-m", "tests.fuzz.worker", str(corpus)]
        self._child: subprocess.Popen[str] | None = None
        self._log: IO[bytes] | None = None
        self._warm: set[str] = set()

    def run(self, target: str, seed: int, case: int) -> dict[str, Any]:
        """The answer to one case; "signal" or "hang" where there was none."""
        if target not in self._warm:
            answer = self.ask(f"{target} {seed} calm", CALM_S)
            if answer["outcome"] != "ok":
                raise AssertionError(f"good input of the target {target} is refused: {answer}")
            self._warm.add(target)
        answer = self.ask(f"{target} {seed} {case}", LIMIT_S)
        if answer["outcome"] in ("ok", "refused", "unclear", "traceback") and answer["mib"] > LIMIT_MIB:
            answer |= {"outcome": "memory", "said": f"took {answer['mib']} MiB more; {answer['said']}"}
        return answer

    def close(self) -> None:
        """Ends the process."""
        self._warm.clear()
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            for stream in (self._child.stdin, self._child.stdout, self._log):
                if stream is not None:
                    stream.close()
            self._child = None

    def _begin(self) -> None:
        if self._child is not None:
            return
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 (lives as long as the process)
        paths = [str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "OMP_NUM_THREADS": "1",
                       "COLUMNS": "100000"}  # fmt: skip
        self._child = subprocess.Popen(
            self.command,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, cwd=ROOT, env=environment, text=True,
        )  # fmt: skip

    def ask(self, question: str, limit_s: float) -> dict[str, Any]:
        """The answer to one line, of a process that is started where there is none."""
        self._begin()
        child = self._child
        assert child is not None
        assert child.stdin is not None
        assert child.stdout is not None
        began = time.monotonic()
        child.stdin.write(question + "\n")
        child.stdin.flush()
        ready, _, _ = select.select([child.stdout], [], [], limit_s)
        line = child.stdout.readline() if ready else ""
        if line:
            return json.loads(line)
        if ready:
            outcome, said = "signal", f"{_death(child.wait())}\n{self._said()}"
        else:
            child.send_signal(signal.SIGABRT)  # faulthandler then says where it was
            with_trace = time.monotonic() + 2.0
            while child.poll() is None and time.monotonic() < with_trace:
                time.sleep(0.05)
            outcome, said = "hang", f"{self._said()}\nno answer within {limit_s:g} s"
        self.close()
        return {"outcome": outcome, "said": said, "seconds": time.monotonic() - began, "mib": 0, "words": ()}

    def _said(self) -> str:
        assert self._log is not None
        self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, self._log.tell() - 20_000))
        return self._log.read().decode("utf-8", "replace")


def _death(code: int) -> str:
    return f"died of {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"


def fuzz(
    corpus: Path, targets: Sequence[str], seed: int, cases: Callable[[str], Iterable[int]],
    heard: Callable[[Failure], None] = lambda _: None, until: float = float("inf"),
) -> list[Run]:  # fmt: skip
    """Runs cases of each target, and begins none later than ``until`` on the monotonic clock; targets share the time.

    Args:
        corpus: of good files.
        targets: their names.
        seed: of all cases.
        cases: target -> numbers of its cases.
        heard: called with each failure.
        until: when to stop.
    """
    runs = []
    worker = Worker(corpus)
    try:
        for left, target in zip(range(len(targets), 0, -1), targets, strict=True):
            run, began = Run(target), time.monotonic()
            end = began + (until - began) / left
            for case in cases(target):
                if time.monotonic() > end:
                    break
                answer = worker.run(target, seed, case)
                outcome = answer["outcome"]
                run.outcomes[outcome] += 1
                run.slowest, run.largest = max(run.slowest, answer["seconds"]), max(run.largest, answer["mib"])
                if outcome not in ("ok", "refused"):
                    failure = Failure(target, seed, case, outcome, answer["said"])
                    run.failures.append(failure)
                    heard(failure)
            run.seconds = time.monotonic() - began
            runs.append(run)
    finally:
        worker.close()
    return runs


def table(runs: list[Run]) -> str:
    """Lines for a person, one a target, and their sum."""
    names = ("target", "cases", *OUTCOMES, "seconds", "slowest s", "most MiB")
    rows = [
        [run.target, str(run.outcomes.total()), *(str(run.outcomes[name]) for name in OUTCOMES), f"{run.seconds:.0f}",
         f"{run.slowest:.1f}", str(run.largest)]
        for run in runs
    ]  # fmt: skip
    total = Counter[str]()
    for run in runs:
        total += run.outcomes
    seconds, slowest = sum(run.seconds for run in runs), max((run.slowest for run in runs), default=0.0)
    largest = max((run.largest for run in runs), default=0)
    counts = (str(total[name]) for name in OUTCOMES)
    rows.append(["all", str(total.total()), *counts, f"{seconds:.0f}", f"{slowest:.1f}", str(largest)])
    widths = [max(len(row[k]) for row in (names, *rows)) for k in range(len(names))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in (names, *rows)]
    return "\n".join(lines)
