"""What a live run came to."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ._loop import LoopRun
from ._update import SinkHealth


@dataclass(slots=True)
class LiveReport:
    """What a run came to.

    ``estimated``: frames with an answer, valid or not; ``valid``: of these; ``notices``: updates of the watchdog;
    ``dropped``: frames that gave way to newer ones; ``unusable``: that were black, of another size, or the same as the
    one before. Latencies from mid-exposure to the estimate, to within 2 %.
    ``cpu_share``: of one core. ``end``: why the source ended, empty where the run was stopped. ``loop_runs``: the runs
    of a loop that holds a force, in order.
    """

    seconds: float = 0.0
    frames_in: int = 0
    estimated: int = 0
    valid: int = 0
    notices: int = 0
    dropped: int = 0
    unusable: int = 0
    reconnects: int = 0
    latency_p50_s: float = math.nan
    latency_p99_s: float = math.nan
    cpu_share: float = 0.0
    statuses: Counter[str] = field(default_factory=Counter[str])
    sinks: Mapping[str, SinkHealth] = field(default_factory=dict[str, SinkHealth])
    end: str = ""
    loop_runs: Sequence[LoopRun] = ()

    def text(self) -> str:
        """A few lines for people."""
        p50, p99 = 1e3 * self.latency_p50_s, 1e3 * self.latency_p99_s
        counts = (
            f"{self.seconds:.1f} s: {self.frames_in} frames, {self.estimated} estimated, {self.valid} with a force, "
            f"{self.dropped} dropped for newer ones, {self.unusable} unusable, {self.notices} notices of the watchdog"
        )
        lines = [
            counts,
            f"image to force: {p50:.1f} ms (p50), {p99:.1f} ms (p99); {self.cpu_share:.0%} of a core",
        ]
        if self.reconnects:
            lines.append(f"the source was opened again {self.reconnects} times")
        for name, sink in self.sinks.items():
            if sink.ended:
                lines.append(f"{sink.message} (after {sink.taken} updates)")
                continue
            times = "once" if sink.failures == 1 else f"{sink.failures} times"
            failed = f", failed {times} ({sink.message})" if sink.failures else ""
            hung = ", hangs" if sink.hung else ""
            lines.append(f"{name}: {sink.taken} updates, {sink.dropped} dropped{failed}{hung}")
        lines += [f"run {number} of the loop: {run.text()}" for number, run in enumerate(self.loop_runs, start=1)]
        return "\n".join([*lines, *([self.end] if self.end else [])])

    def figures(self) -> dict[str, Any]:
        """All of it as JSON values; latencies in seconds."""
        return {
            **{name: getattr(self, name) for name in self.__slots__ if name not in ("statuses", "sinks", "loop_runs")},
            "statuses": dict(self.statuses),
            "loop_runs": [asdict(run) for run in self.loop_runs],
            "sinks": {name: asdict(sink) for name, sink in self.sinks.items()},
        }
