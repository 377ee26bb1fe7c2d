"""A session for calibration: line, tip and width in each frame, with force, knob and stage."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..alignment import ForceCorrections, StageMotion, labels
from ..errors import InputError
from ..estimators.session import Detected, Detection, LineFrame
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
"""Time constant of the shaft's creep: earlier forces still bend it a little."""
AXIS_SHARE = 0.1
"""Share of the visible length next to the tip that defines the direction of its axis."""
FORCE_RATE_S = 6e-3
"""Half the time over which the rate of the force is computed."""
STAGE_RATE_S = 10e-3
"""Half the time over which the speed of the stage is computed."""
CORRELATION_S = 0.02
"""Time over which the residual of the readings is correlated."""
MAX_FRAMES = 3000
"""Largest number of frames that are read; in a longer recording only every second, third ... frame is read."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationSession:
    """The frames (n) of one recording in which the catheter is detected.

    Attributes:
        name: name of the session.
        info: session metadata.
        view: name of the view.
        stamp_ns: (n,) stamps.
        shapes: (n) detected shapes.
        lines: (n) lines in m, for the fit of the rod.
        scale_m_per_px: stated scale.
        dome_m: (n, 2) middle of the tip's dome, base frame.
        diameter_px: (n,) detected diameter.
        force_n: (n, 2) force of the tissue on the tip in the stated base frame; NaN without a force.
        rate_n_per_s: (n, 2) rate of the force.
        past_n: (n, 2) mean of the preceding forces over the time constant of creep.
        knob_deg: (n,) angle of the knob; NaN without a knob.
        knob_series: stamps and angles in degrees of all readings of the knob.
        stage_names: names of the stage's axes.
        stage_m: (n, axes) positions of the stage.
        stage_m_per_s: (n, axes) speeds of the stage.
        stage_to_base: (2, axes) unit vectors in which the axes move the tissue, in the base frame by the sensor's
            stated pose; NaN if the sensor does not show it.
        stage_angle_std_rad: standard deviation of their angle.
        clock_map: clock of the force log.
        tare: tare of the forces.
        inertia: inertia of the carried mass.
        mass_std_kg: standard deviation of the carried mass for each axis of ``inertia``.
        frames: number of frames that were read.
    """

    name: str
    info: SessionInfo
    view: str
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
        """(n,) time in s since the first frame."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    def subset(self, rows: IntArray) -> "CalibrationSession":
        """Returns the frames at ``rows``."""
        kept = rows.tolist()
        return replace(
            self, stamp_ns=self.stamp_ns[rows], shapes=[self.shapes[row] for row in kept],
            lines=[self.lines[row] for row in kept], dome_m=self.dome_m[rows], diameter_px=self.diameter_px[rows],
            force_n=self.force_n[rows], rate_n_per_s=self.rate_n_per_s[rows], past_n=self.past_n[rows],
            knob_deg=self.knob_deg[rows], stage_m=self.stage_m[rows], stage_m_per_s=self.stage_m_per_s[rows],
        )  # fmt: skip


def read_session(
    path: Path | str,
    *,
    bench: SessionInfo | None = None,
    seconds: float = math.inf,
    contact_free: bool = False,
    vision: VisionSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> CalibrationSession:
    """Detects the catheter in the frames of a recording, and reads force, knob and stage at them.

    Args:
        path: a recording (.mcap).
        bench: metadata that replace the recording's own.
        seconds: length of the beginning that is read.
        contact_free: whether nothing touches the tip in any frame: every force is 0, and none is needed.
        vision: settings of the detection.
        progress: called with the share of frames that are read.

    Returns:
        The frames in which the catheter is detected, with force, knob and stage at them.

    Raises:
        FileFormatError: the recording does not exist.
        InputError: the recording has no images, no scale is stated, the clamp is advanced in it, or the catheter is
            detected in none of its frames.
    """
    settings = vision or VisionSettings()
    with RecordingReader(path) as reader:
        info = reader.session_info.updated(bench) if bench is not None else reader.session_info
        if not reader.views:
            raise InputError(f"{path}: the recording holds no images, and calibration needs them")
        settings = settings.for_views(reader.views, path)
        view = settings.view
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
        stride = -(-wanted // MAX_FRAMES)
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
            detected = detection.read(Observation(event.stamp_ns, {view: event.image}))
            if isinstance(detected, Detected) and detected.shape.centreline is not None:
                rows.append(row)
                shapes.append(detected.shape)
                frame_of = detected.frame
                lines.append(detected.line())
            if progress is not None:
                progress((row + 1) / wanted)
        if not rows or frame_of is None:
            raise InputError(f"{path}: the catheter is detected in none of {wanted} frames; see `tipforce inspect`")
        detected_rows = np.array(rows, np.int64)
        return _with_streams(reader, info, view, detected_rows, wanted, shapes, lines, scale, contact_free=contact_free)


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
    """Adds force, knob and stage to the frames in which the catheter is detected.

    Args:
        reader: the recording.
        info: session metadata.
        view: the view.
        rows: (n,) indices of the frames in which the catheter is detected.
        wanted: number of frames at the beginning of the recording that were read.
        shapes: (n) detected shapes.
        lines: (n) the same as lines in m.
        scale: scale of the view, m/px.
        contact_free: whether every force is 0.
    """
    facts, stamps_ns = reader.info, reader.stamps(view)[:wanted]
    force = rate = np.zeros((wanted, 2))
    if not contact_free:
        force = _forces(reader, info, view)[:wanted]
        rate = _forces(reader, info, view, FORCE_RATE_S) - _forces(reader, info, view, -FORCE_RATE_S)
        rate = np.nan_to_num(rate[:wanted] / (2.0 * FORCE_RATE_S))
    past = _past(stamps_ns, force)
    stage = reader.stage_readings()
    names = tuple(stage[0][1]) if stage else ()
    positions, speeds = np.full((2, wanted, len(names)), math.nan)
    if names:
        # the stage reaches its commanded position later by the same time by which its movement is late in the force
        reference_ns = np.array([facts.inertia.reference_ns])
        delay_ns = facts.clock_map.camera_ns(reference_ns) - facts.inertia.stage_ns(reference_ns)
        late_ns = int(delay_ns[0]) if facts.inertia.axes else 0
        stage_ns = np.array([stamp for stamp, _ in stage], np.int64) + late_ns
        for k, name in enumerate(names):
            unit = 1e-3 if name.endswith("_mm") else 1.0
            axis_m = unit * np.array([values[name] for _, values in stage])
            positions[:, k] = np.interp(stamps_ns, stage_ns, axis_m)
            ends = [np.interp(stamps_ns + sign * round(STAGE_RATE_S * 1e9), stage_ns, axis_m) for sign in (-1, 1)]
            speeds[:, k] = (ends[1] - ends[0]) / (2.0 * STAGE_RATE_S)
    knob = reader.actuation_at(stamps_ns).get(KNOB, np.full(wanted, math.nan))
    if KNOB in info.actuation.constant:
        knob = np.full(wanted, info.actuation.constant[KNOB])
    mass_std = _mass_std(reader) if facts.inertia.axes else np.zeros(0)
    directions, angle_std = _directions(facts.inertia, info, names, mass_std)
    return CalibrationSession(
        name=info.name or reader.path.stem, info=info, view=view, stamp_ns=stamps_ns[rows], shapes=shapes, lines=lines,
        scale_m_per_px=scale, dome_m=_domes(shapes, scale, info),
        diameter_px=np.array([shape.diameter_px for shape in shapes]), force_n=force[rows], rate_n_per_s=rate[rows],
        past_n=past[rows], knob_deg=knob[rows], knob_series=(stamps_ns, knob), stage_names=names,
        stage_m=positions[rows], stage_m_per_s=speeds[rows], stage_to_base=directions, stage_angle_std_rad=angle_std,
        clock_map=facts.clock_map, tare=facts.tare, inertia=facts.inertia, mass_std_kg=mass_std, frames=wanted,
    )  # fmt: skip


def _forces(reader: RecordingReader, info: SessionInfo, view: str, later_s: float = 0.0) -> FloatArray:
    """Returns the (frames, 2) forces of the tissue on the tip in the base frame; NaN without a force.

    Args:
        reader: the recording, whose metadata state the sensor's pose that `labels` uses.
        info: session metadata that replace it: the forces are turned back to the sensor and then by this pose.
        view: the view whose frames are used.
        later_s: time after each frame at which the force is read.
    """
    stream = next((each.name for each in reader.info.streams.values() if each.kind == "wrench"), None)
    if stream is None:
        return np.full((len(reader.stamps(view)), 2), math.nan)
    recorded_n = labels(reader, camera=view, force=stream, later_s=later_s).force_n
    recorded = reader.info.sensor or SensorInfo()
    force_n = np.nan_to_num(recorded_n) @ recorded.matrix @ info.sensor.matrix.T
    force_n[np.isnan(recorded_n[:, :2]).any(axis=1)] = math.nan
    return force_n[:, :2]


def _past(stamp_ns: IntArray, force: FloatArray) -> FloatArray:
    """Returns the (n, 2) mean of the forces before each stamp, with a weight that decays; gaps are interpolated.

    It is 0 before the first frame with a force.
    """
    past = np.zeros_like(force)
    is_known = np.isfinite(force).all(axis=1)
    if not is_known.any():
        return past
    known = np.stack(
        [np.interp(stamp_ns, stamp_ns[is_known], column[is_known], left=0.0) for column in force.T], axis=1
    )
    decay = np.exp(-np.diff(stamp_ns) * 1e-9 / CREEP_S)
    for k in range(1, len(force)):
        past[k] = decay[k - 1] * past[k - 1] + (1.0 - decay[k - 1]) * 0.5 * (known[k - 1] + known[k])
    return past


def _domes(shapes: Sequence[DetectedShape], scale: float, info: SessionInfo) -> FloatArray:
    """Returns the (n, 2) middle of the tip's dome in m, in one base frame for the session.

    The base frame is the median of the detected ones, so that its noise in a frame does not move the dome. The middle
    is one radius of the shaft behind the detected tip, along the axis of the last `AXIS_SHARE` of the length.
    """
    bases = [shape.base for shape in shapes if shape.base is not None]
    turn = complex(np.mean([np.exp(1j * base.angle_rad) for base in bases]))
    base = BasePose(np.median([each.origin_px for each in bases], axis=0), float(np.angle(turn)))
    radius = 0.5 * (info.catheter.diameter_m or 0.0)
    rows: list[FloatArray] = []
    for shape in shapes:
        assert shape.centreline is not None
        points = base.to_base(shape.centreline.points) * scale
        arc = arc_length(points)
        axis = points[-1] - points[int(np.searchsorted(arc, (1.0 - AXIS_SHARE) * arc[-1]))]
        rows.append(points[-1] - radius * axis / np.linalg.norm(axis))
    return np.array(rows)


def _directions(
    inertia: Inertia, info: SessionInfo, names: tuple[str, ...], mass_std_kg: FloatArray
) -> tuple[FloatArray, float]:
    """Returns (2, axes) unit vectors of the stage's axes in the base frame, and the standard deviation of their angle.

    A sensor under the tissue reads the tissue's mass times minus the acceleration. The angles of perpendicular axes are
    averaged.
    """
    directions, angle_std = np.full((2, len(names)), math.nan), math.inf
    angle = math.radians(info.sensor.angle_deg or 0.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    stds: dict[str, float] = {}
    for axis, gain, std in zip(inertia.axes, inertia.gain_kg, mass_std_kg.tolist(), strict=True):
        if axis in names:
            mass_kg = float(np.linalg.norm(gain[:2]))
            directions[:, names.index(axis)] = -turn @ gain[:2] / mass_kg
            stds[axis] = std / mass_kg
            angle_std = min(angle_std, stds[axis])
    if {STAGE_FORWARD, STAGE_ACROSS} <= set(stds):
        forward, across = names.index(STAGE_FORWARD), names.index(STAGE_ACROSS)
        # across is to the right of forward, and forward is the direction in which the tip is pressed
        from_across = np.array([-directions[1, across], directions[0, across]])
        weights = np.array([stds[STAGE_FORWARD] ** -2, stds[STAGE_ACROSS] ** -2])
        forward_sum = weights[0] * directions[:, forward] + weights[1] * from_across
        directions[:, forward] = forward_sum / np.linalg.norm(forward_sum)
        directions[:, across] = directions[1, forward], -directions[0, forward]
        angle_std = float(weights.sum() ** -0.5)
    return directions, angle_std


def _mass_std(reader: RecordingReader) -> FloatArray:
    """Returns the (axes,) standard deviations of the carried mass in kg, from the readings without contact."""
    facts = reader.info
    stamps, force, _ = reader.wrenches(next(s.name for s in facts.streams.values() if s.kind == "wrench"))
    force = facts.plausibility.corrected(stamps, force)
    stage = StageMotion.of(reader.stage_readings())
    seconds = (stamps - stamps[0]) * 1e-9
    contact_free = np.zeros(len(stamps), np.bool_)
    for start, end in facts.tare.stretches_s:
        contact_free |= (seconds >= start) & (seconds <= end)
    contact_free &= np.isfinite(force).any(axis=1)
    acceleration = stage.acceleration(facts.inertia.stage_ns(stamps[contact_free]), facts.inertia.axes)
    corrections = ForceCorrections(facts.sensor, facts.tare, facts.inertia, stage)
    residual_n = force[contact_free] - facts.tare.force_n - corrections.carried(stamps[contact_free])
    # readings within `CORRELATION_S` have similar errors, so their number counts less
    readings_per_s = len(residual_n) / max(float(np.ptp(seconds[contact_free])), 1e-9)
    variance = float(np.nanvar(residual_n)) * CORRELATION_S * readings_per_s
    information = acceleration.T @ acceleration + 1e-12 * np.eye(acceleration.shape[1])
    return np.sqrt(variance * np.diag(np.linalg.inv(information)))
