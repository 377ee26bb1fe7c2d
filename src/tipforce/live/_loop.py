"""State, run summaries and commands of a loop that holds a force, as a page shows and sends them."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal, Protocol

from ..clinical import WINDOW_N
from ..units import newtons_to_grams
from ._numbers import number

LoopState = Literal["idle", "approach", "contact", "hold", "retract", "stopped"]


@dataclass(frozen=True, slots=True)
class LoopStatus:
    """State of a loop as the page shows it. Numbers that are not known are NaN.

    Attributes:
        state: present state of the loop.
        reason: reason for the state, or the missing condition.
        resumes: whether the loop is idle and will begin its approach again by itself.
        target_n: force that shall be held in the end.
        wanted_n: present set point; NaN outside of hold.
        limit_n: limit of the safety layer.
        held: whether the force has been at the target for the last seconds.
        force_n: last force that the loop has read; NaN if it was not valid or has expired.
        upper_n: upper end of the 90 % interval of that force.
        place_mm: position of the drives on the path, from the marked start; NaN without a path.
        length_mm: length of the path; NaN without a path.
        action: action of the safety layer on the present command.
        peak_n: largest estimated force of the newest run.
        above_limit_s: time of that run with the estimated force above the limit.
        true_peak_n: largest true force of the newest run, of a simulated bench.
        true_above_limit_s: time of that run with the true force above the limit, of a simulated bench.
        axes: positions of the drives by name.
        start: positions of the drives at the marked start.
        goal: positions of the drives at the marked goal.
    """

    state: LoopState = "idle"
    reason: str = ""
    resumes: bool = False
    target_n: float = float("nan")
    wanted_n: float = float("nan")
    limit_n: float = float("nan")
    held: bool = False
    force_n: float = float("nan")
    upper_n: float = float("nan")
    place_mm: float = float("nan")
    length_mm: float = float("nan")
    action: str = ""
    peak_n: float = float("nan")
    above_limit_s: float = float("nan")
    true_peak_n: float = float("nan")
    true_above_limit_s: float = float("nan")
    axes: Mapping[str, float] = field(default_factory=dict[str, float])
    start: Mapping[str, float] = field(default_factory=dict[str, float])
    goal: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def moves(self) -> bool:
        """Whether the drives are commanded now, or will be without a further command of the operator."""
        return self.resumes or self.state not in ("idle", "stopped")

    def text(self) -> str:
        """Returns the JSON text that pages get; a number that is not known is null."""
        values = {name: number(value) if isinstance(value, float) else value for name, value in asdict(self).items()}
        return json.dumps(values | {"answer": "loop", "moves": self.moves})


@dataclass(slots=True)
class ForcePeak:
    """Peak of a force, and the times that it was above the limits, in one run of a loop.

    Attributes:
        peak_n: largest force; NaN before the first force.
        above_limit_s: time above the limit that the loop had at that time.
        above_safe_s: time above the thesis's safe limit.
    """

    peak_n: float = math.nan
    above_limit_s: float = 0.0
    above_safe_s: float = 0.0

    def add(self, force_n: float, limit_n: float, dt_s: float) -> None:
        """Adds a force.

        Args:
            force_n: the force in newtons.
            limit_n: limit of the loop at that time, in newtons.
            dt_s: duration of the force in seconds.
        """
        self.peak_n = max(force_n, 0.0 if math.isnan(self.peak_n) else self.peak_n)
        self.above_limit_s += dt_s * (force_n > limit_n)
        self.above_safe_s += dt_s * (force_n > WINDOW_N[1])

    def text(self, name: str, limit_n: float) -> str:
        """Returns one sentence for people.

        Args:
            name: name of the force, as in "estimated".
            limit_n: limit of the loop in newtons.
        """
        if math.isnan(self.peak_n):
            return f"The {name} force was not known."
        return (
            f"Peak of the {name} force: {self.peak_n:.2f} N ({newtons_to_grams(self.peak_n):.0f} g); "
            f"{self.above_limit_s:.2f} s above the loop's limit, {limit_n:g} N; "
            f"{self.above_safe_s:.2f} s above the thesis's safe limit, {WINDOW_N[1]:g} N."
        )


@dataclass(slots=True)
class LoopRun:
    """One run of a loop: from the operator's start until the drives rest at the marked start, or a stop is released.

    Attributes:
        limit_n: limit of the loop at the end of the run.
        seconds: duration of the run.
        held_s: time in which the force was at the target.
        not_valid_s: time without a valid estimate.
        estimated: peak of the estimated force.
        true: peak of the true force of a simulated bench; None if the true force is not known.
    """

    limit_n: float = math.nan
    seconds: float = 0.0
    held_s: float = 0.0
    not_valid_s: float = 0.0
    estimated: ForcePeak = field(default_factory=ForcePeak)
    true: ForcePeak | None = None

    def add(self, status: LoopStatus, dt_s: float, true_n: float = math.nan) -> None:
        """Adds ``dt_s`` seconds in which the loop had this ``status``.

        Args:
            status: state of the loop, with the force and the limit.
            dt_s: duration in seconds.
            true_n: true force in newtons; NaN if it is not known.
        """
        self.limit_n = status.limit_n
        self.seconds += dt_s
        self.held_s += dt_s * status.held
        if math.isnan(status.force_n):
            self.not_valid_s += dt_s
        else:
            self.estimated.add(status.force_n, status.limit_n, dt_s)
        if not math.isnan(true_n):
            self.true = self.true or ForcePeak()
            self.true.add(true_n, status.limit_n, dt_s)

    def text(self) -> str:
        """Returns a summary of the run in one line for people."""
        sentences = [
            f"{self.seconds:.1f} s, held for {self.held_s:.1f} s, no valid force for {self.not_valid_s:.1f} s.",
            self.estimated.text("estimated", self.limit_n),
        ]
        if self.true is not None:
            sentences.append(self.true.text("true", self.limit_n))
        return " ".join(sentences)


class LoopCommands(Protocol):
    """The operator's commands of a loop. May be called from any thread; the page shows the errors that they raise."""

    @property
    def status(self) -> LoopStatus:
        """State at the last command to the drives, with the present force; returns immediately."""
        ...

    def mark_start(self) -> None:
        """Marks the present position of the drives as the start of the path."""

    def mark_goal(self) -> None:
        """Marks the present position of the drives as the end of the path."""

    def start(self) -> None:
        """Begins a run."""

    def retract(self) -> None:
        """Ends the run: the drives go back to the marked start."""

    def stop(self) -> None:
        """Brakes now and keeps the drives still until `release`. Does not wait for other threads."""

    def release(self) -> None:
        """Accepts commands again after a stop; nothing moves before the next command."""
