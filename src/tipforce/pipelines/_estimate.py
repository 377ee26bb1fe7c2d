"""A model over a whole video, folder or recording: a table with a row per frame, and the video with the force in it."""

import csv
import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .._system.contexts import ClosedAtExit
from ..alignment import observations
from ..clinical import ClinicalState, ContactMonitor, ContactSettings, Duration
from ..datasets import file_names, open_source
from ..errors import InputError
from ..estimators import Estimator, Progress, Stream, load_model
from ..io import (
    VideoWriter,
    atomic_text,
    can_be_read_again,
    frame_count,
    images_beforehand,
    require_actuation,
    spread_images,
    steady_reading,
)
from ..types import (
    DEFAULT_VIEW,
    KNOB,
    Actuation,
    Event,
    FloatArray,
    ForceEstimate,
    Frame,
    Image,
    Observation,
    SessionInfo,
    ShapeFeatures,
    Source,
    Status,
    read_bench,
    views_of,
    views_text,
)
from ..units import newtons_to_grams
from ..vision import Reasons, VisionSettings, auto_calibrate, bends_against_knob, draw_estimate

COLUMNS = (
    "frame", "time_s", "stamp_ns", "magnitude_n", "magnitude_low_n", "magnitude_high_n",
    "fx_n", "fx_low_n", "fx_high_n", "fy_n", "fy_low_n", "fy_high_n", "fz_n", "fz_low_n", "fz_high_n",
    "magnitude_g", "contact", "status", "detail",
    "contact_state", "contact_class", "above_limit", "window_s", "limit_s", "unknown_s",
    "integral_g_s", "integral_low_g_s", "integral_high_g_s", "file_name",
)  # fmt: skip
"""Columns of the table. Number of the frame from 0, seconds since the first one; low and high are the ends of the 90 %
intervals, contact and above_limit are probabilities. Since the first frame: seconds in the force window, above the
limit and without a valid estimate, and the force-time integral of the known time; see `ClinicalState`. At the end the
name of the image file, empty for other sources."""


@dataclass(slots=True)
class EstimateReport:
    """Result of a run over a file.

    Attributes:
        contact: thresholds of the clinical state.
        clinical: clinical state after the last frame.
        frames: number of frames.
        statuses: status -> number of frames.
        reasons: reasons of the frames without a valid estimate.
        magnitudes_n: magnitude of each valid estimate in newtons.
        update_s: time of each frame from image to force, without reading it.
        reads: the views that the method reads, see `view_line`.
    """

    contact: ContactSettings = field(default_factory=ContactSettings)
    clinical: ClinicalState | None = None
    frames: int = 0
    statuses: Counter[str] = field(default_factory=Counter[str])
    reasons: Reasons = field(default_factory=Reasons)
    magnitudes_n: list[float] = field(default_factory=list[float])
    update_s: list[float] = field(default_factory=list[float])
    reads: str = ""

    @property
    def valid(self) -> int:
        """Frames with a force."""
        return self.statuses[Status.VALID]

    def add(self, estimate: ForceEstimate, clinical: ClinicalState, seconds: float) -> None:
        """Counts one estimate.

        Args:
            estimate: the estimate of a frame.
            clinical: the clinical state after it.
            seconds: time that its computation took, s.
        """
        self.frames += 1
        self.clinical = clinical
        self.statuses[estimate.status.value] += 1
        self.update_s.append(seconds)
        if estimate.valid:
            self.magnitudes_n.append(estimate.magnitude_n)
        else:
            self.reasons.add(f"{estimate.status.value}: {estimate.detail}")

    def text(self) -> str:
        """Returns a few lines for people."""
        lines = [f"{self.frames} frames, {self.valid} with a force"]
        if self.magnitudes_n:
            low, mean, high = min(self.magnitudes_n), float(np.mean(self.magnitudes_n)), max(self.magnitudes_n)
            grams = ", ".join(f"{newtons_to_grams(n):.1f}" for n in (low, mean, high))
            lines[0] += f": {low:.3f} to {high:.3f} N, mean {mean:.3f} N (smallest, mean, largest {grams} g)"
        if self.clinical is not None:
            lines += _clinical_lines(self.clinical, self.contact)
        lines += self.reasons.lines(3)
        if self.reads:
            lines.insert(0, self.reads)
        p50_ms, p99_ms = np.percentile(self.update_s, [50, 99]) * 1e3
        return "\n".join([*lines, f"image to force: {p50_ms:.2f} ms (p50), {p99_ms:.2f} ms (p99)"])

    def figures(self) -> dict[str, Any]:
        """Returns all of it as JSON values; None where there is no force at all."""
        forces_n = self.magnitudes_n
        magnitude = {"min": min(forces_n), "mean": float(np.mean(forces_n)), "max": max(forces_n)} if forces_n else None
        return {
            "frames": self.frames,
            "valid": self.valid,
            "statuses": dict(self.statuses),
            "magnitude_n": magnitude,
            "clinical": None if self.clinical is None else _clinical_figures(self.clinical, self.contact),
            "update_ms": {f"p{p}": 1e3 * float(np.percentile(self.update_s, p)) for p in (50, 99)},
        }


Frames = str | Path | Source | Iterable[Frame] | Iterable[Image]
"""Input of an estimation: a file or folder, an open source, or images with or without stamps."""


def estimate(
    model: Estimator | str | Path,
    frames: Frames,
    *,
    bench: SessionInfo | str | Path | None = None,
    actuation: Mapping[str, float] | None = None,
    frame_rate_hz: float = 30.0,
) -> Iterator[ForceEstimate]:
    """Estimates the contact force on every frame, as the frames come.

    Args:
        model: a fitted estimator, or the model folder to load; ``pretrained/NAME`` comes with the program.
        frames: a video, DICOM file, folder of images, recording or dataset; an open `Source`; or an iterable of
            `Frame` or of images, (h, w) grey or (h, w, 3) RGB, uint8.
        bench: metadata of the session in place of those in the file: a `SessionInfo` or a ``bench.toml``.
        actuation: constant readings of drives that ``frames`` do not carry, as ``{"knob_deg": 10.0}``.
        frame_rate_hz: rate of images without stamps.

    Yields:
        One `ForceEstimate` a frame, in newtons in the base frame; it says ``valid`` or why not.

    Raises:
        InputError: the file cannot be read, or readings or metadata that the model needs are missing; the message
            names them.
        ModelError: the model folder is incomplete or altered.

    >>> import tipforce
    >>> frames = [np.zeros((480, 640), np.uint8)]
    >>> next(tipforce.estimate("pretrained/dcfe", frames)).status.value
    'no_catheter'
    """
    estimator = model if isinstance(model, Estimator) else load_model(model)
    stated = session_info_from(bench)
    with source_of(frames, stated, actuation or {}, frame_rate_hz) as source:
        estimator = for_source(estimator, source)
        stream = start_stream(estimator, source)
        for observation in observations(source, estimator.views, apart=not estimator.needs_all_views):
            yield stream.update(observation).checked()


def session_info_from(bench: SessionInfo | str | Path | None) -> SessionInfo:
    """Returns metadata that a caller states as such, as a ``bench.toml``, or not at all."""
    if bench is None:
        return SessionInfo()
    return bench if isinstance(bench, SessionInfo) else read_bench(bench)


def source_of(frames: Frames, stated: SessionInfo, actuation: Mapping[str, float], frame_rate_hz: float) -> Source:
    """Opens frames as a `Source`.

    Args:
        frames: a file or folder, an open source, or images.
        stated: metadata that replace those of a file.
        actuation: constant readings of drives by name.
        frame_rate_hz: rate of images without stamps.

    Returns:
        The source; an open one is returned as it is.

    Raises:
        FileFormatError: a file cannot be read.
        InputError: metadata or readings are stated for an open source, which has its own.
    """
    if isinstance(frames, str | Path):
        return open_source(frames, actuation=actuation, stated=stated)
    if isinstance(frames, Source):
        if actuation or stated != SessionInfo():
            raise InputError(
                "an open source has its own metadata and readings; state bench and actuation when it is opened"
            )
        return frames
    return _Given(frames, stated, {**stated.actuation.constant, **actuation}, frame_rate_hz)


def for_source(estimator: Estimator, source: Source) -> Estimator:
    """Adapts a method to the views of a source, and checks that the source has all that the method needs.

    Args:
        estimator: the fitted method.
        source: a source.

    Returns:
        The method; see `Estimator.for_views`.

    Raises:
        InputError: a view, a reading or metadata are missing; the message names them.
    """
    name, views = getattr(source, "path", source.session_info.name), views_of(source)
    try:
        estimator = estimator.for_views(views)
    except InputError as error:
        advice = f"; state view={views[0]} to read that one" if estimator.view_setting else ""
        raise InputError(f"{name}: {error}{advice}") from None
    require_actuation(source, estimator.required_actuation)
    if why := estimator.obstacle(source.session_info):
        raise InputError(f"{name}: {why}")
    return estimator


def view_line(estimator: Estimator, source: Source) -> str:
    """Returns a line on the views that a method reads of a source that has several; empty where it has one.

    Args:
        estimator: the method, for this source.
        source: the source.
    """
    views = views_of(source)
    return f"reads {views_text(estimator.views)} of {', '.join(views)}" if len(views) > 1 else ""


def start_stream(estimator: Estimator, source: Source) -> Stream:
    """Starts the stream of a method for a source.

    A method that resolves its detection on images gets images from all over a file beforehand. Where it uses the
    reading of the knob, it is also checked that the shaft bends to the side to which the knob should bend it.

    Args:
        estimator: the fitted method.
        source: an open source.

    Returns:
        The stream.

    Raises:
        InputError: the shaft at rest bends against the knob whose reading the method uses.
    """
    if not can_be_read_again(source):
        return estimator.start(source.session_info)
    view, info = estimator.views[0], source.session_info
    views = estimator.views if estimator.calibrates_on_images else ()
    by_knob_per_m = _knob_curvature(source, view) if KNOB in estimator.required_actuation else None
    images = {each: images_beforehand(source, each) for each in views}
    if by_knob_per_m is not None:
        why = _against_knob(images.get(view) or spread_images(source, view), info, view, by_knob_per_m)
        if why:
            raise InputError(f"{getattr(source, 'path', info.name)}: {why}")
    return estimator.start_on(info, images)


def _knob_curvature(source: Source, view: str) -> float | None:
    """Returns the free curvature in 1/m that a knob at rest sets: gain times reading, and the rest curvature.

    None where it is not known, or where the view is a projection, whose lines do not show the curvature in space.
    """
    info = source.session_info
    gain, view_info = info.actuation.knob_gain_per_m_deg, info.view(view)
    if gain is None or view_info.projection is not None or view_info.modality == "xray":
        return None
    knob_deg = steady_reading(source, KNOB)
    rest = info.catheter.rest_curvature_per_m
    return None if knob_deg is None else gain * knob_deg + (float(np.mean(rest)) if rest else 0.0)


def _against_knob(images: Sequence[Image], info: SessionInfo, view: str, asked_per_m: float) -> str:
    """Returns why the shaft in the images bends against the curvature that the knob sets; "" if it does not."""
    try:
        vision = auto_calibrate(VisionSettings(view=view), images, info)
    except InputError:
        return ""  # without a detected catheter the images say nothing about its bending
    return bends_against_knob(vision, images, info, asked_per_m)


class _Given(ClosedAtExit):
    """Images or frames of the caller's as a `Source`, with constant readings in front of them."""

    def __init__(
        self,
        frames: Iterable[Frame] | Iterable[Image],
        info: SessionInfo,
        actuation: Mapping[str, float],
        frame_rate_hz: float,
    ) -> None:
        self._frames, self.session_info, self._actuation = frames, info, dict(actuation)
        self._step_ns = round(1e9 / frame_rate_hz)

    @property
    def views(self) -> set[str]:
        """The view of the first frame, for which it waits, and where the metadata have this view, theirs too."""
        frames = iter(self._frames)
        first = next(frames, None)
        self._frames = frames if first is None else chain((first,), frames)  # type: ignore[assignment]
        view = first.view if isinstance(first, Frame) else DEFAULT_VIEW
        stated = self.session_info.views
        return {view, *stated} if view in stated else {view}

    def __iter__(self) -> Iterator[Event]:
        """Yields the constant readings once, then the frames; images without stamps get those of the frame rate."""
        for number, image in enumerate(self._frames):
            frame = image if isinstance(image, Frame) else Frame(number * self._step_ns, image)
            if number == 0 and self._actuation:
                yield Actuation(frame.stamp_ns, self._actuation)
            yield frame


def write_estimates(
    estimator: Estimator,
    source: Source,
    forces: Path | TextIO,
    *,
    overlay: Path | None = None,
    full_scale_n: float = 0.3,
    contact: ContactSettings | None = None,
    progress: Progress | None = None,
) -> EstimateReport:
    """Estimates the force on every frame of a source, and writes one row of `COLUMNS` for each.

    Args:
        estimator: a fitted one.
        source: an open source; see `open_source`.
        forces: a CSV file or an open stream.
        overlay: an .mp4 with shape, force, value, interval and status in it; None: none is written.
        full_scale_n: force whose arrow is a quarter of the image long.
        contact: force window, limit and threshold of contact; by default `ContactSettings`.
        progress: called with the current step and the share that is done.

    Returns:
        Counts of frames and statuses, the magnitudes, and the time of each update.

    Raises:
        InputError: ``source`` holds no frame, or lacks readings or metadata that ``estimator`` needs.
    """
    estimator = for_source(estimator, source)
    view = estimator.views[0]
    total, names = frame_count(source, view), file_names(source, view)
    stream = start_stream(estimator, source)
    monitor = ContactMonitor(contact)
    report, first_ns = EstimateReport(monitor.settings, reads=view_line(estimator, source)), 0
    with ExitStack() as stack:
        table = stack.enter_context(atomic_text(forces)) if isinstance(forces, Path) else forces
        video = stack.enter_context(_Overlay(overlay, view, full_scale_n)) if overlay else None
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(COLUMNS)
        for observation in observations(source, estimator.views, apart=not estimator.needs_all_views):
            start = time.perf_counter()
            force = stream.update(observation).checked()
            seconds = time.perf_counter() - start
            clinical = monitor.update(force)
            report.add(force, clinical, seconds)
            first_ns = force.stamp_ns if report.frames == 1 else first_ns
            elapsed = f"{(force.stamp_ns - first_ns) * 1e-9:.6f}"
            name = names.get(force.stamp_ns, "")
            rows.writerow([report.frames - 1, elapsed, *_row(force), *_clinical_row(clinical), name])
            if video and view in observation.views:
                video.add(observation, force)
            if progress:
                progress(f"frame {report.frames}", min(1.0, report.frames / total) if total else 0.0)
        if not report.frames:
            raise InputError(
                f"{getattr(source, 'path', source.session_info.name)}: holds no frame of the view {view!r} to estimate "
                "a force from; look with `tipforce inspect`"
            )
    return report


def _row(estimate: ForceEstimate) -> list[str]:
    """Returns the cells of the columns "stamp_ns" to "detail" of `COLUMNS`; unknown numbers are empty."""
    cells = [str(estimate.stamp_ns), _cell(estimate.magnitude_n), *_ends(estimate.magnitude_interval_n)]
    for value, interval in zip(estimate.force_n.tolist(), estimate.interval_n, strict=True):
        cells += [_cell(value), *_ends(interval)]
    grams = newtons_to_grams(estimate.magnitude_n)
    cells += ["" if math.isnan(value) else f"{value:.3f}" for value in (grams, estimate.contact)]
    return [*cells, estimate.status.value, estimate.detail]


def _clinical_row(state: ClinicalState) -> list[str]:
    """Returns the cells of the columns "contact_state" to "integral_high_g_s" of `COLUMNS`."""
    times = (state.window.seconds, state.limit.seconds, state.unknown_s)
    integral = (state.integral_g_s, *state.integral_interval_g_s)
    return [
        state.contact.value,
        state.contact_class.value,
        *("" if math.isnan(value) else f"{value:.3f}" for value in (state.above_limit, *times, *integral)),
    ]


def _clinical_lines(state: ClinicalState, settings: ContactSettings) -> list[str]:
    """Returns times and integral in words."""
    low, high = settings.window_n
    window, limit = _of_known(state.window, state), _of_known(state.limit, state)
    ends = state.integral_interval_g_s
    between = "no interval" if math.isnan(ends[0]) else f"{ends[0]:.0f} to {ends[1]:.0f}"
    known = f"{state.known_s:.1f} s with a force"
    return [
        f"in the window of {low:g} to {high:g} N: {window}",
        f"above {settings.limit_n:g} N: {limit}; unknown: {state.unknown_s:.1f} s of {state.elapsed_s:.1f} s",
        f"force-time integral: {state.integral_g_s:.0f} g s ({between}) over {known}",
    ]


def _of_known(duration: Duration, state: ClinicalState) -> str:
    share = f" ({duration.seconds / state.known_s:.0%})" if state.known_s > 0.0 else ""
    return f"{duration.seconds:.1f} s{share}, by the 90 % intervals {duration.least_s:.1f} to {duration.most_s:.1f} s"


def _clinical_figures(state: ClinicalState, settings: ContactSettings) -> dict[str, Any]:
    """Returns JSON values; None where something is not known."""
    return {
        "settings": settings.model_dump(),
        "elapsed_s": state.elapsed_s,
        "unknown_s": state.unknown_s,
        "window_s": asdict(state.window),
        "limit_s": asdict(state.limit),
        "integral_g_s": state.integral_g_s,
        "integral_interval_g_s": [None if math.isnan(end) else end for end in state.integral_interval_g_s],
    }


def _cell(newtons: float) -> str:
    return f"{newtons:.6f}" if math.isfinite(newtons) else ""


def _ends(interval: FloatArray) -> list[str]:
    """Returns both ends, or neither: an interval without an end states nothing."""
    return [_cell(end) for end in interval.tolist()] if np.isfinite(interval).all() else ["", ""]


class _Overlay:
    """The video with the force in it; its rate is that of the first two frames."""

    def __init__(self, path: Path, view: str, full_scale_n: float) -> None:
        self.path, self.view, self.full_scale_n = path, view, full_scale_n
        self.first: Frame | None = None
        self.writer: VideoWriter | None = None
        self.stack = ExitStack()

    def add(self, observation: Observation, estimate: ForceEstimate) -> None:
        """Draws one frame and writes it; the first one is kept until the second one gives the frame rate."""
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
            raise InputError("an overlay needs images, and these data are ready-made shape coefficients")
        return draw_estimate(image, estimate.shape, estimate, full_scale_n=self.full_scale_n)

    def __enter__(self) -> "_Overlay":
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if error is None and self.writer is None and self.first is not None:
            self._open(24.0)
        # The writer learns of an error too, so that its file does not appear.
        self.stack.__exit__(kind, error, trace)
