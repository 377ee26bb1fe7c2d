"""What a page shows of a loop that holds a force, what its runs came to, and what a page may command."""

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
    """A loop as the page shows it.

    ``reason``: why it is in its state, or what is missing. ``resumes``: it is idle and will begin its approach
    again by itself. ``target_n``: what shall be held in the end, ``wanted_n``: just now, NaN outside of hold;
    ``limit_n``: that of its safety layer. ``held``: the force has been at the target for the last seconds.
    ``force_n``: as the loop has read it last, NaN where that was not valid or has expired; ``upper_n``: upper end of
    its 90 % interval. ``place_mm`` of ``length_mm``: where the drives are on the path from the marked start; NaN
    without a path. ``axes``: what the drives read, by name; ``start`` and ``goal``: where they were marked.
    ``action``: what the safety layer does with what is wanted. ``peak_n`` and ``above_limit_s``: largest estimated
    force of the newest run, and the time that it was above the limit; ``true_peak_n`` and ``true_above_limit_s``: of
    the true force, where the bench is simulated. NaN where not known.
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
        """Whether the drives are commanded now, or will be without anybody's word."""
        return self.resumes or self.state not in ("idle", "stopped")

    def text(self) -> str:
        """As the JSON text that pages get; a number that is not known is null."""
        values = {name: number(value) if isinstance(value, float) else value for name, value in asdict(self).items()}
        return json.dumps(values | {"answer": "loop", "moves": self.moves})


@dataclass(slots=True)
class ForcePeak:
    """Peak of a force, and the time that it was above the limits, in one run of a loop.

    ``peak_n``: NaN before the first force. ``above_limit_s``: above the loop's limit of that time.
    ``above_safe_s``: above the thesis's safe limit.
    """

    peak_n: float = math.nan
    above_limit_s: float = 0.0
    above_safe_s: float = 0.0

    def add(self, force_n: float, limit_n: float, dt_s: float) -> None:
        """Adds a force that lasted ``dt_s`` seconds."""
        self.peak_n = max(force_n, 0.0 if math.isnan(self.peak_n) else self.peak_n)
        self.above_limit_s += dt_s * (force_n > limit_n)
        self.above_safe_s += dt_s * (force_n > WINDOW_N[1])

    def text(self, name: str, limit_n: float) -> str:
        """Returns one sentence for people; ``name`` is that of the force."""
        if math.isnan(self.peak_n):
            return f"The {name} force was not known."
        return (
            f"Peak of the {name} force: {self.peak_n:.2f} N ({newtons_to_grams(self.peak_n):.0f} g); "
            f"{self.above_limit_s:.2f} s above the loop's limit, {limit_n:g} N; "
            f"{self.above_safe_s:.2f} s above the thesis's safe limit, {WINDOW_N[1]:g} N."
        )


@dataclass(slots=True)
class LoopRun:
    """One run of a loop, from the operator's start until the drives rest at the marked start, or a stop is released.

    ``limit_n``: that of the loop at its end. ``held_s``: time in which the force was at the target. ``not_valid_s``:
    time without a valid estimate. ``true``: the force of a simulated bench; None where nobody knows it.
    """

    limit_n: float = math.nan
    seconds: float = 0.0
    held_s: float = 0.0
    not_valid_s: float = 0.0
    estimated: ForcePeak = field(default_factory=ForcePeak)
    true: ForcePeak | None = None

    def add(self, status: LoopStatus, dt_s: float, true_n: float = math.nan) -> None:
        """Adds ``dt_s`` seconds in which the loop was as ``status`` says.

        Args:
            status: with the force and the limit.
            dt_s: how long.
            true_n: true force in newtons; NaN where it is not known.
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
        """Returns the run in one line for people."""
        sentences = [
            f"{self.seconds:.1f} s, held for {self.held_s:.1f} s, no valid force for {self.not_valid_s:.1f} s.",
            self.estimated.text("estimated", self.limit_n),
        ]
        if self.true is not None:
            sentences.append(self.true.text("true", self.limit_n))
        return " ".join(sentences)


class LoopCommands(Protocol):
    """The operator's commands of a loop. May be called from any thread; what they raise is shown on the page."""

    @property
    def status(self) -> LoopStatus:
        """As it was at its last command to the drives, with the force as it is now; returns at once."""
        ...

    def mark_start(self) -> None:
        """The path begins where the drives are now."""
        ...

    def mark_goal(self) -> None:
        """The path ends where the drives are now."""
        ...

    def start(self) -> None:
        """Begin a run."""
        ...

    def retract(self) -> None:
        """End the run: back to the marked start."""
        ...

    def stop(self) -> None:
        """Brake now, and stay until `release`. Waits for nothing that may be busy for long."""
        ...

    def release(self) -> None:
        """After a stop commands count again; nothing moves before the next one."""
        ...
