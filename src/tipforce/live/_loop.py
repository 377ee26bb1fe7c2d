"""What a page shows of a loop that holds a force, and what it may command. The loop itself is somebody else's."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal, Protocol

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
    ``action``: what the safety layer does with what is wanted.
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
