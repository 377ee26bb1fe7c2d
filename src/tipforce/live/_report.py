"""Summary of a live run."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from ._loop import LoopRun
from ._update import SinkHealth


@dataclass(slots=True)
class LiveReport:
    """Summary of a run.

    Attributes:
        seconds: duration of the run.
        frames_in: number of frames of the first view that arrived.
        estimated: number of frames with an estimate, valid or not.
        valid: number of frames with a valid estimate.
        notices: number of updates of the watchdog.
        dropped: number of frames that were replaced by newer ones before they were estimated.
        unusable: number of frames that were black, of another size, or the same as the one before.
        reconnects: number of times that the source was opened again.
        latency_p50_s: median latency from mid-exposure to the estimate, to within 2 %.
        latency_p99_s: 99th percentile of that latency, to within 2 %.
        cpu_share: processor time, as a share of one core.
        statuses: number of estimates by status.
        sinks: health of each sink at its end.
        end: reason why the source ended; "" if the run was stopped.
        loop_runs: runs of a loop that holds a force, in order.
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
        """Returns a few lines for people."""
        p50, p99 = 1e3 * self.latency_p50_s, 1e3 * self.latency_p99_s
        counts = (
            f"{self.seconds:.1f} s: {self.frames_in} frames, {self.estimated} estimated, {self.valid} with a force, "
            f"{self.dropped} dropped for newer ones, {self.unusable} unusable, {self.notices} notices of the watchdog"
        )
        lines = [counts, f"image to force: {p50:.1f} ms (p50), {p99:.1f} ms (p99); {self.cpu_share:.0%} of a core"]
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
        """Returns all values as JSON values; latencies are in seconds."""
        return {
            **{name: getattr(self, name) for name in self.__slots__ if name not in ("statuses", "sinks", "loop_runs")},
            "statuses": dict(self.statuses),
            "loop_runs": [asdict(run) for run in self.loop_runs],
            "sinks": {name: asdict(sink) for name, sink in self.sinks.items()},
        }
