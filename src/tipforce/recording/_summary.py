"""A recording at a glance: figures and a small plot."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..types import Context
from ._reader import RecordingInfo

__all__ = ["RecordingSummary", "plot_summary", "summarise"]


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """``force_range_n``: component -> (smallest, largest) label; ``duration_s`` from first to last stamp."""

    path: Path
    info: RecordingInfo
    context: Context
    duration_s: float
    image_size: tuple[int, int] | None
    labelled: int
    force_range_n: Mapping[str, tuple[float, float]]
    actuation_range: Mapping[str, tuple[float, float]]

    def figures(self) -> dict[str, Any]:
        """All of it as JSON values."""
        raise NotImplementedError


def summarise(path: Path | str) -> RecordingSummary:
    """Streams, rates, drops, offset, tare, ranges of the recording at ``path``."""
    raise NotImplementedError


def plot_summary(summary: RecordingSummary, path: Path | str) -> None:
    """Force over time, the frames' intervals and a picture, as a PNG or SVG."""
    raise NotImplementedError
