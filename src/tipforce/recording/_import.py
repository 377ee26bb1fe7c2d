"""Video or images plus force log -> one recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..types import Context
from ..vision import VisionSettings
from ._facts import SensorPose
from ._summary import RecordingSummary

__all__ = ["ForceColumns", "ImportReport", "import_run"]


@dataclass(frozen=True, slots=True)
class ForceColumns:
    """Which columns of a force log hold what; None: found by its header. A leading "-" turns an axis round."""

    time: str | None = None
    fx: str | None = None
    fy: str | None = None
    fz: str | None = None
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    force_unit: Literal["N", "mN", "g", "counts"] | None = None
    counts_per_n: float | None = None


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What was written, and what a person should know of it."""

    summary: RecordingSummary
    remarks: tuple[str, ...]


def import_run(
    frames: Path | str,
    force_log: Path | str | None,
    target: Path | str,
    *,
    columns: ForceColumns | None = None,
    sensor: SensorPose | None = None,
    actuation: Mapping[str, float] | None = None,
    knob_column: str | None = None,
    knob_log: Path | str | None = None,
    tare: Literal["auto", "none"] | tuple[float, float] = "auto",
    offset_ms: Literal["auto", "none"] | float = "auto",
    align_start: bool = False,
    context: Context | None = None,
    vision: VisionSettings | None = None,
    lossless: bool = False,
    jpeg_quality: int = 90,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> ImportReport:
    """Write ``target`` (.mcap) from a video or a folder of images and a force log."""
    raise NotImplementedError
