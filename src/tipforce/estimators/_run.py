"""A model over a whole video, folder or recording: a table with a row per frame, and the video with the force in it."""

import csv
import math
import time
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np

from ..alignment import observations
from ..errors import InputError
from ..io import VideoWriter, frame_count, require_actuation
from ..types import FloatArray, ForceEstimate, Frame, Image, Observation, SessionInfo, ShapeFeatures, Source, Status
from ..units import newtons_to_grams
from ..vision import Reasons, draw_estimate
from ._base import Estimator, Progress
from ._needed import missing_facts
from ._shows import ShowsShape, view_of

__all__ = ["COLUMNS", "RunReport", "write_estimates"]

COLUMNS = (
    "stamp_ns", "magnitude_n", "magnitude_low_n", "magnitude_high_n",
    "fx_n", "fx_low_n", "fx_high_n", "fy_n", "fy_low_n", "fy_high_n", "fz_n", "fz_low_n", "fz_high_n",
    "magnitude_g", "contact", "status", "detail",
)  # fmt: skip
"""Of the table; low and high are the ends of the 90 % intervals, contact is a probability."""


@dataclass(slots=True)
class RunReport:
    """What a run over a file came to. ``update_s``: time of each frame from picture to force, without reading it."""

    frames: int = 0
    statuses: Counter[str] = field(default_factory=Counter[str])
    reasons: Reasons = field(default_factory=Reasons)
    magnitudes_n: list[float] = field(default_factory=list[float])
    update_s: list[float] = field(default_factory=list[float])

    @property
    def valid(self) -> int:
        """Frames with a force."""
        return self.statuses[Status.VALID]

    def add(self, estimate: ForceEstimate, seconds: float) -> None:
        """Count one estimate."""
        self.frames += 1
        self.statuses[estimate.status.value] += 1
        self.update_s.append(seconds)
        if estimate.valid:
            self.magnitudes_n.append(estimate.magnitude_n)
        else:
            self.reasons.add(f"{estimate.status.value}: {estimate.detail}")

    def text(self) -> str:
        """A few lines for people."""
        lines = [f"{self.frames} frames, {self.valid} with a force"]
        if self.magnitudes_n:
            low, mean, high = min(self.magnitudes_n), float(np.mean(self.magnitudes_n)), max(self.magnitudes_n)
            grams = ", ".join(f"{newtons_to_grams(n):.1f}" for n in (low, mean, high))
            lines[0] += f": {low:.3f} to {high:.3f} N, mean {mean:.3f} N (smallest, mean, largest {grams} g)"
        lines += self.reasons.lines(3)
        p50, p99 = np.percentile(self.update_s, [50, 99]) * 1e3
        return "\n".join([*lines, f"picture to force: {p50:.2f} ms (p50), {p99:.2f} ms (p99)"])

    def figures(self) -> dict[str, Any]:
        """All of it as JSON values; None where there is no force at all."""
        sizes = self.magnitudes_n
        return {
            "frames": self.frames,
            "valid": self.valid,
            "statuses": dict(self.statuses),
            "magnitude_n": {"min": min(sizes), "mean": float(np.mean(sizes)), "max": max(sizes)} if sizes else None,
            "update_ms": {f"p{p}": 1e3 * float(np.percentile(self.update_s, p)) for p in (50, 99)},
        }


def write_estimates(
    estimator: Estimator,
    source: Source,
    forces: Path | TextIO,
    *,
    overlay: Path | None = None,
    full_scale_n: float = 0.3,
    progress: Progress | None = None,
) -> RunReport:
    """Estimate the force on every frame of ``source``; a row of `COLUMNS` each to ``forces``, a CSV file or a stream.

    Cells are empty where a value is unknown. ``overlay``: also an .mp4 with shape, force, value, interval and status,
    where an arrow of ``full_scale_n`` is a quarter of the picture long. Files appear when they are complete, or not at
    all. Raises InputError where ``source`` holds no frame, or lacks actuation or facts that ``estimator`` needs.
    """
    require_actuation(source, estimator.needed_actuation)
    missing = missing_facts(estimator.needed_facts, source.session_info)
    if missing:
        raise InputError(f"{getattr(source, 'path', source.session_info.name)}: {missing}")
    view = view_of(estimator)
    total = frame_count(source, view)
    stream = estimator.start(source.session_info)
    report = RunReport()
    with ExitStack() as stack:
        table = stack.enter_context(_replacing(forces)) if isinstance(forces, Path) else forces
        video = (
            stack.enter_context(_Overlay(overlay, estimator, source.session_info, view, full_scale_n))
            if overlay
            else None
        )
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(COLUMNS)
        for observation in observations(source, view):
            start = time.perf_counter()
            estimate = stream.update(observation)
            report.add(estimate, time.perf_counter() - start)
            rows.writerow(_row(estimate))
            if video:
                video.add(observation, estimate)
            if progress:
                progress(f"frame {report.frames}", min(1.0, report.frames / total) if total else 0.0)
        if not report.frames:
            raise InputError(f"no frame of the view {view!r} to estimate a force from; look with `tipforce inspect`")
    return report


def _row(estimate: ForceEstimate) -> list[str]:
    cells = [str(estimate.stamp_ns), _cell(estimate.magnitude_n), *_ends(estimate.magnitude_interval_n)]
    for value, interval in zip(estimate.force_n.tolist(), estimate.interval_n, strict=True):
        cells += [_cell(value), *_ends(interval)]
    grams = newtons_to_grams(estimate.magnitude_n)
    cells += ["" if math.isnan(value) else f"{value:.3f}" for value in (grams, estimate.contact)]
    return [*cells, estimate.status.value, estimate.detail]


def _cell(newtons: float) -> str:
    return f"{newtons:.6f}" if math.isfinite(newtons) else ""


def _ends(interval: FloatArray) -> list[str]:
    """Both ends, or neither: an interval without an end says nothing."""
    return [_cell(end) for end in interval.tolist()] if np.isfinite(interval).all() else ["", ""]


@contextmanager
def _replacing(path: Path) -> Generator[TextIO]:
    """A text file that gets its name when it is complete."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w", encoding="utf-8", newline="") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


class _Overlay:
    """The video with the force in it; its rate is that of the first two frames."""

    def __init__(self, path: Path, estimator: Estimator, info: SessionInfo, view: str, full_scale_n: float) -> None:
        if not path.parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
        self.path, self.estimator, self.view, self.full_scale_n = path, estimator, view, full_scale_n
        self.session_info = info
        self.first: Frame | None = None
        self.writer: VideoWriter | None = None
        self.stack = ExitStack()

    def add(self, observation: Observation, estimate: ForceEstimate) -> None:
        """Draw one frame and write it."""
        frame = Frame(observation.stamp_ns, self._drawn(observation, estimate))
        if self.writer:
            self.writer.write(frame)
        elif self.first is None:
            self.first = frame
        else:
            self._open(1e9 / max(1, frame.stamp_ns - self.first.stamp_ns)).write(frame)

    def _open(self, rate: float) -> VideoWriter:
        assert self.first is not None
        self.writer = self.stack.enter_context(VideoWriter(self.path, float(np.clip(rate, 0.01, 1000.0))))
        self.writer.write(self.first)
        return self.writer

    def _drawn(self, observation: Observation, estimate: ForceEstimate) -> Image:
        image = observation.views[self.view]
        if isinstance(image, ShapeFeatures):
            raise InputError("an overlay needs pictures, and these data are ready-made shape coefficients")
        sighting = (
            self.estimator.look(observation, self.session_info)[0] if isinstance(self.estimator, ShowsShape) else None
        )
        return draw_estimate(image, sighting, estimate, full_scale_n=self.full_scale_n)

    def __enter__(self) -> "_Overlay":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None and self.writer is None and self.first is not None:
            self._open(24.0)
        # The writer learns of an error too, so that its file does not appear.
        self.stack.__exit__(kind, error, trace)
