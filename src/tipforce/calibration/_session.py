"""A session as calibration needs it: line, tip and width in each frame, with force, knob and stage beside them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..alignment import ForceCorrections, StageMotion, labels
from ..errors import InputError
from ..estimators.rod import Detected, Detection, LineFrame
from ..geometry import arc_length
from ..io import ClockMap, Inertia, RecordingReader, Tare, any_reading, spread_images
from ..mechanics.planar import Line
from ..types import (
    ADVANCE,
    KNOB,
    STAGE_ACROSS,
    STAGE_FORWARD,
    BasePose,
    DetectedShape,
    FloatArray,
    Frame,
    IntArray,
    Observation,
    SensorInfo,
    SessionInfo,
)
from ..vision import VisionSettings

CREEP_S = 2.0
"""Time constant of the shaft's creep: forces so long ago still bend it a little."""
_AXIS_SHARE = 0.1
"""Of the visible length, next to the tip, that gives the direction of its axis."""
_RATE_S = 6e-3
"""Half the time over which the force's rate is taken."""
_STAGE_RATE_S = 10e-3
"""The same of the stage's speed."""
_CORRELATED_S = 0.02
_MOST_FRAMES = 3000
"""Of a longer recording every second, third ... frame is read."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationSession:
    """The frames (n) of one recording in which the catheter is detected.

    ``lines``: as the rod is fitted to them, in m; ``scale_m_per_px``: stated. ``dome_m`` (n, 2): middle of the tip's
    dome in the base frame; ``diameter_px`` (n,). ``force_n`` (n, 2): of the tissue on the tip in the stated base
    frame, NaN where there is none; ``rate_n_per_s`` (n, 2): how fast it changes; ``past_n`` (n, 2): its mean over the
    time of creep. ``knob_deg`` (n,), NaN without a knob; ``knob_series``: all its readings (stamps, degrees).
    ``stage_m`` (n, axes): the stage's positions at the frames, ``stage_m_per_s`` their speeds; ``stage_to_base``
    (2, axes): where its axes move the tissue, in the base frame as the sensor's stated pose has it, NaN where the
    sensor does not show it, and ``stage_angle_std_rad``. ``mass_std_kg``: of the carried mass, for each axis of
    ``inertia``. ``frames``: so many were read.
    """

    name: str
    info: SessionInfo
    stamp_ns: IntArray
    shapes: Sequence[DetectedShape]
    lines: Sequence[Line]
    scale_m_per_px: float
    dome_m: FloatArray
    diameter_px: FloatArray
    force_n: FloatArray
    rate_n_per_s: FloatArray
    past_n: FloatArray
    knob_deg: FloatArray
    knob_series: tuple[IntArray, FloatArray]
    stage_names: tuple[str, ...]
    stage_m: FloatArray
    stage_m_per_s: FloatArray
    stage_to_base: FloatArray
    stage_angle_std_rad: float
    clock_map: ClockMap
    tare: Tare
    inertia: Inertia
    mass_std_kg: FloatArray
    frames: int

    @property
    def seconds(self) -> FloatArray:
        """(n,) since the first frame."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    def subset(self, rows: IntArray) -> "CalibrationSession":
        """Some of the frames."""
        kept = rows.tolist()
        return replace(
            self,
            stamp_ns=self.stamp_ns[rows],
            shapes=[self.shapes[row] for row in kept],
            lines=[self.lines[row] for row in kept],
            dome_m=self.dome_m[rows],
            diameter_px=self.diameter_px[rows],
            force_n=self.force_n[rows],
            rate_n_per_s=self.rate_n_per_s[rows],
            past_n=self.past_n[rows],
            knob_deg=self.knob_deg[rows],
            stage_m=self.stage_m[rows],
            stage_m_per_s=self.stage_m_per_s[rows],
        )


def read_session(
    path: Path | str,
    *,
    bench: SessionInfo | None = None,
    seconds: float = math.inf,
    contact_free: bool = False,
    vision: VisionSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> CalibrationSession:
    """Detects the catheter in the frames of a recording and reads what belongs to them.

    Args:
        path: a recording (.mcap).
        bench: metadata in place of the recording's own.
        seconds: only so much of its beginning.
        contact_free: nothing touches in any frame: every force is 0, and none is needed.
        vision: how the catheter is detected.
        progress: called with the share of frames that are read.

    Raises:
        FileFormatError: there is no such recording.
        InputError: it has no images, no scale is stated, the clamp is advanced in it, or the catheter is detected in
            none of its frames.
    """
    settings = vision or VisionSettings()
    with RecordingReader(path) as reader:
        info = reader.session_info.updated(bench) if bench is not None else reader.session_info
        view = settings.view if settings.view in reader.views else next(iter(reader.views), None)
        if view is None:
            raise InputError(f"{path}: the recording holds no images, and calibration needs them")
        settings = settings.model_copy(update={"view": view})
        scale = info.view(view).metres_per_px
        if scale is None:
            raise InputError(
                f"{path}: views.{view}.metres_per_px is not stated; find it with `tipforce calibrate --ruler` or "
                "--board, or state it in bench.toml"
            )
        if any_reading(reader, ADVANCE):
            raise InputError(
                f"{path}: the clamp is advanced in this recording ({ADVANCE}), which calibration does not follow; "
                "record one with the clamp at 0"
            )
        stamps = reader.stamps(view)
        wanted = int(np.searchsorted(stamps, stamps[0] + min(seconds, 1e6) * 1e9, side="right"))
        stride = -(-wanted // _MOST_FRAMES)
        detection = Detection(settings, info, spread_images(reader, view))
        rows: list[int] = []
        shapes: list[DetectedShape] = []
        lines: list[Line] = []
        frame_of: LineFrame | None = None
        for row, event in enumerate(reader.events(view)):
            if row >= wanted:
                break
            if row % stride or not isinstance(event, Frame):
                continue
            found = detection.read(Observation(event.stamp_ns, {view: event.image}))
            if isinstance(found, Detected) and found.shape.centreline is not None:
                rows.append(row)
                shapes.append(found.shape)
                frame_of = found.frame
                lines.append(found.line())
            if progress is not None:
                progress((row + 1) / wanted)
        if not rows or frame_of is None:
            raise InputError(f"{path}: the catheter is detected in none of {wanted} frames; see `tipforce inspect`")
        kept = np.array(rows, np.int64)
        return _with_streams(reader, info, view, kept, wanted, shapes, lines, scale, contact_free=contact_free)


def _with_streams(
    reader: RecordingReader,
    info: SessionInfo,
    view: str,
    rows: IntArray,
    wanted: int,
    shapes: Sequence[DetectedShape],
    lines: Sequence[Line],
    scale: float,
    *,
    contact_free: bool,
) -> CalibrationSession:
    """The session of the frames ``rows`` of ``view``, of ``wanted`` that were read."""
    facts, every = reader.info, reader.stamps(view)[:wanted]
    force = rate = np.zeros((wanted, 2))
    if not contact_free:
        force = _forces(reader, info, view)[:wanted]
        rate = _forces(reader, info, view, _RATE_S) - _forces(reader, info, view, -_RATE_S)
        rate = np.nan_to_num(rate[:wanted] / (2.0 * _RATE_S))
    past = _past(every, force)
    stage = reader.stage_readings()
    names = tuple(stage[0][1]) if stage else ()
    places, speeds = np.full((2, wanted, len(names)), math.nan)
    if names:
        # the stage reaches what it is commanded as much later as its movement shows late in the force
        at = np.array([facts.inertia.reference_ns])
        late_ns = int((facts.clock_map.camera_ns(at) - facts.inertia.stage_ns(at))[0]) if facts.inertia.axes else 0
        when = np.array([stamp for stamp, _ in stage], np.int64) + late_ns
        for k, name in enumerate(names):
            unit = 1e-3 if name.endswith("_mm") else 1.0
            course = unit * np.array([values[name] for _, values in stage])
            places[:, k] = np.interp(every, when, course)
            ends = [np.interp(every + way * round(_STAGE_RATE_S * 1e9), when, course) for way in (-1, 1)]
            speeds[:, k] = (ends[1] - ends[0]) / (2.0 * _STAGE_RATE_S)
    knob = reader.actuation_at(every).get(KNOB, np.full(wanted, math.nan))
    if KNOB in info.actuation.constant:
        knob = np.full(wanted, info.actuation.constant[KNOB])
    mass_std = _mass_std(reader) if facts.inertia.axes else np.zeros(0)
    directions, angle_std = _directions(facts.inertia, info, names, mass_std)
    return CalibrationSession(
        name=info.name or reader.path.stem,
        info=info,
        stamp_ns=every[rows],
        shapes=shapes,
        lines=lines,
        scale_m_per_px=scale,
        dome_m=_domes(shapes, scale, info),
        diameter_px=np.array([shape.diameter_px for shape in shapes]),
        force_n=force[rows],
        rate_n_per_s=rate[rows],
        past_n=past[rows],
        knob_deg=knob[rows],
        knob_series=(every, knob),
        stage_names=names,
        stage_m=places[rows],
        stage_m_per_s=speeds[rows],
        stage_to_base=directions,
        stage_angle_std_rad=angle_std,
        clock_map=facts.clock_map,
        tare=facts.tare,
        inertia=facts.inertia,
        mass_std_kg=mass_std,
        frames=wanted,
    )


def _forces(reader: RecordingReader, info: SessionInfo, view: str, later_s: float = 0.0) -> FloatArray:
    """(frames, 2): in the base frame of ``info``; NaN where there is none."""
    stream = next((each.name for each in reader.info.streams.values() if each.kind == "wrench"), None)
    if stream is None:
        return np.full((len(reader.stamps(view)), 2), math.nan)
    found = labels(reader, camera=view, force=stream, later_s=later_s).force_n
    recorded = reader.info.sensor or SensorInfo()
    turned = np.nan_to_num(found) @ recorded.matrix @ info.sensor.matrix.T
    turned[np.isnan(found[:, :2]).any(axis=1)] = math.nan
    return turned[:, :2]


def _past(stamp_ns: IntArray, force: FloatArray) -> FloatArray:
    """(n, 2): mean of the forces before each stamp, the recent ones weighing more; gaps are bridged by straight lines.

    There is no estimate before the first frame with a force.
    """
    past = np.zeros_like(force)
    there = np.isfinite(force).all(axis=1)
    if not there.any():
        return past
    known = np.stack([np.interp(stamp_ns, stamp_ns[there], column[there], left=0.0) for column in force.T], axis=1)
    keep = np.exp(-np.diff(stamp_ns) * 1e-9 / CREEP_S)
    for k in range(1, len(force)):
        past[k] = keep[k - 1] * past[k - 1] + (1.0 - keep[k - 1]) * 0.5 * (known[k - 1] + known[k])
    return past


def _domes(shapes: Sequence[DetectedShape], scale: float, info: SessionInfo) -> FloatArray:
    """(n, 2) m: the middle of the tip's dome, in the base frame of the whole session."""
    bases = [shape.base for shape in shapes if shape.base is not None]
    turn = complex(np.mean([np.exp(1j * base.angle_rad) for base in bases]))
    base = BasePose(np.median([each.origin_px for each in bases], axis=0), float(np.angle(turn)))
    radius = 0.5 * (info.catheter.diameter_m or 0.0)
    rows: list[FloatArray] = []
    for shape in shapes:
        assert shape.centreline is not None
        points = base.to_base(shape.centreline.points) * scale
        arc = arc_length(points)
        axis = points[-1] - points[int(np.searchsorted(arc, (1.0 - _AXIS_SHARE) * arc[-1]))]
        rows.append(points[-1] - radius * axis / np.linalg.norm(axis))
    return np.array(rows)


def _directions(
    inertia: Inertia, info: SessionInfo, names: tuple[str, ...], mass_std_kg: FloatArray
) -> tuple[FloatArray, float]:
    """(2, axes): unit vectors in the base frame, and the standard deviation of their angle.

    A sensor under the tissue shows its mass times minus the acceleration. Axes that stand across one another share what
    both tell of their angle.
    """
    found, spread = np.full((2, len(names)), math.nan), math.inf
    angle = math.radians(info.sensor.angle_deg or 0.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    stds: dict[str, float] = {}
    for axis, gain, std in zip(inertia.axes, inertia.gain_kg, mass_std_kg.tolist(), strict=True):
        if axis in names:
            size = float(np.linalg.norm(gain[:2]))
            found[:, names.index(axis)] = -turn @ gain[:2] / size
            stds[axis] = std / size
            spread = min(spread, stds[axis])
    if {STAGE_FORWARD, STAGE_ACROSS} <= set(stds):
        forward, across = names.index(STAGE_FORWARD), names.index(STAGE_ACROSS)
        # seen along the tissue's way forward, across is its right: forward is named by where the tip is pressed to
        other = np.array([-found[1, across], found[0, across]])
        weights = np.array([stds[STAGE_FORWARD] ** -2, stds[STAGE_ACROSS] ** -2])
        both = weights[0] * found[:, forward] + weights[1] * other
        found[:, forward] = both / np.linalg.norm(both)
        found[:, across] = found[1, forward], -found[0, forward]
        spread = float(weights.sum() ** -0.5)
    return found, spread


def _mass_std(reader: RecordingReader) -> FloatArray:
    """(axes,) standard deviation of the carried mass, kg: from the scatter of readings in the contact-free stretch."""
    facts = reader.info
    stamps, force, _ = reader.wrenches(next(s.name for s in facts.streams.values() if s.kind == "wrench"))
    force = facts.plausibility.corrected(stamps, force)
    stage = StageMotion.of(reader.stage_readings())
    seconds = (stamps - stamps[0]) * 1e-9
    free = np.zeros(len(stamps), np.bool_)
    for start, end in facts.tare.stretches_s:
        free |= (seconds >= start) & (seconds <= end)
    free &= np.isfinite(force).any(axis=1)
    moved = stage.acceleration(facts.inertia.stage_ns(stamps[free]), facts.inertia.axes)
    corrections = ForceCorrections(facts.sensor, facts.tare, facts.inertia, stage)
    left = force[free] - facts.tare.force_n - corrections.carried(stamps[free])
    # what is left is not independent within some hundredths of a second
    spread = float(np.nanvar(left)) * _CORRELATED_S * len(left) / max(float(np.ptp(seconds[free])), 1e-9)
    information = moved.T @ moved + 1e-12 * np.eye(moved.shape[1])
    return np.sqrt(spread * np.diag(np.linalg.inv(information)))
