"""The offset between the force log's clock and the camera's, from the catheter's own deflection.

An elastic shaft takes its shape at once: shape and force belong to the same instant, friction and contact or not. The
bending moment at s is the lever from s to the tip times the force, and both lever and bend are in the image. So

    B = c0(t) + c1 G + c2 G^2 + c3 G^3,    B = integral w(s) dtheta,    G(t) = integral w(s) [lever(s) x F(t)]_z ds,

with theta the shaft's angle, w a bell over the part that bends, c's that hold the unknown stiffness, and a c0 that
follows the shaft's slow drift. The force is shifted by trial offsets; the most likely one leaves the smallest residual.
A free regression on both components of the force is worse by milliseconds: friction goes with the wall's velocity, so
its coefficient can stand for a shift in time. Physics binds the two components, up to an error of the sensor's angle
that is fitted with a prior of two degrees.

The bell keeps out what is seen badly: w and its slope vanish at both ends, so no single point of the centreline counts
for much, and the dome, where one flank turns into the other, does not count at all but for the lever. The levers are
turned by one angle for all images, for the seen base turns with the bend and the sensor does not. They end where a
ball of the shaft's diameter touches a wall that lies across the mean force.

The motion of the wall would not do at all: it leads the force by the tissue's loss angle. A drift of 20 ppm between
the clocks is 1.2 ms in 60 s and is left alone; in a recording of many minutes the offset is the one of its middle.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..geometry import arc_length
from ..io import ClockOffset
from ..types import BasePose, FloatArray, IntArray
from ..vision import DetectedShape
from ._timing_fit import SMOOTH_S, Data, Fit, Force, peak

__all__ = ["estimate_offset", "shape_coordinates"]

_STEP_S = 4e-3
_BLOCK_S = 1.0
_MAX_BLOCKS = 150
_REPLICATES = 100
_MIN_EXPLAINED = 0.3
_MAX_STDERR_MS = 5.0
_RIVAL_S = 0.025
_OTHER_DEGREES = (2, 5)
"""Of the elastic law: what they would give tells how much the answer hangs on that choice."""
_FLOOR_MS = 0.5
"""What no cross-check shows: bend and levers are seen with errors of a few hundredths of a pixel; the tare drifts."""
_SEEN_WELL = 0.9
"""Of the shaft's length: the rest is the dome, seen five times worse."""
_LIKELY, _FEW = (0.88, 1.04), 0.1
"""What is seen of a catheter's known length: its base may be hidden, scale and length are known to a few percent."""
_NEARLY = 0.96
_MAX_TURN_DEG, _FREE_GAIN = 10.0, 0.7
"""The stated angle is taken for wrong where another, further off than this, leaves less than this share unexplained."""


def shape_coordinates(
    shapes: Sequence[DetectedShape], *, flexible_share: float = 1.0, length_px: float | None = None
) -> FloatArray:
    """(n, 4): B in rad; what multiplies the force's x and y in G, in px; how the lever's end weighs in them, in px.

    NaN where nothing was found. ``flexible_share``: of the visible length, from the base; a rigid tip does not bend.
    ``length_px``: of the whole catheter, where it is known; a part at the base may be hidden. All centrelines are
    brought to one length: what an image shows beyond it is something else, and where the rigid tip was not detected it
    is drawn on. The base frame's direction is the median one. The lever ends in the middle of the dome; the last column
    is the dome's radius times the integral of w.
    """
    rows = np.full((len(shapes), 4), math.nan)
    turns = np.array([np.exp(1j * shape.base.angle_rad) for shape in shapes if shape.base is not None])
    if turns.size == 0:
        return rows
    middle = complex(turns.mean())
    angle_rad = float(np.angle(middle) + np.median(np.angle(turns * middle.conjugate())))
    end = min(flexible_share, _SEEN_WELL)
    diameters = np.array([shape.diameter_px for shape in shapes])
    known = diameters[np.isfinite(diameters)]
    radius = 0.5 * float(np.median(known)) if known.size else 0.0
    length = _common_length([s.centreline.points for s in shapes if s.centreline is not None], length_px)
    for place, shape in enumerate(shapes):
        if shape.centreline is None or shape.base is None:
            continue
        whole = _of_length(shape.centreline.points, length, flexible_share)
        if whole is None:
            continue
        points = BasePose(shape.base.origin_px, angle_rad).to_base(whole)
        steps = np.diff(points, axis=0)
        angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        share = np.linspace(0.0, 1.0, len(points))
        bell = (1.0 - np.minimum((2.0 * share / end - 1.0) ** 2, 1.0)) ** 2
        axis = points[-1] - points[int(_SEEN_WELL * (len(points) - 1))]
        lever = (points[-1] - radius * axis / np.linalg.norm(axis) - points) * share[1]
        weight = radius * share[1] * float(bell.sum())
        # by parts: angles are smoother than their differences
        rows[place] = -(np.diff(bell) @ angle), -(bell @ lever[:, 1]), bell @ lever[:, 0], weight
    return rows


def _common_length(lines: Sequence[FloatArray], expected_px: float | None) -> float:
    """The usual length, of those that a catheter of ``expected_px`` may show where any do."""
    lengths = np.array([float(arc_length(points)[-1]) for points in lines])
    if expected_px is not None:
        share = lengths / expected_px
        likely = lengths[(share > _LIKELY[0]) & (share < _LIKELY[1])]
        lengths = likely if likely.size >= _FEW * lengths.size else lengths
    return float(np.median(lengths)) if lengths.size else math.nan


def _of_length(points: FloatArray, length: float, flexible_share: float) -> FloatArray | None:
    """``points`` cut, or drawn on straight where only rigid tip is missing, to ``length``; None where more is."""
    arc = arc_length(points)
    if arc[-1] < length * min(_NEARLY, flexible_share - (1.0 - _NEARLY)):
        return None
    if arc[-1] < length:
        axis = points[-1] - points[int(_SEEN_WELL * (len(points) - 1))]
        points = np.vstack([points, points[-1] + (length - arc[-1]) * axis / np.linalg.norm(axis)])
        arc = np.append(arc, length)
    even = np.linspace(0.0, length, len(points))
    return np.stack([np.interp(even, arc, column) for column in points.T], axis=1)


def estimate_offset(
    frame_ns: IntArray, coordinates: FloatArray, force_ns: IntArray, force_n: FloatArray, *, window_s: float = 0.3
) -> ClockOffset:
    """The offset within +-``window_s`` at which force and deflection belong together best.

    ``frame_ns`` (n,), ``coordinates`` (n, 4) of `shape_coordinates`, rows with NaN are left out; ``force_ns`` (m,),
    ``force_n`` (m, 2 or more): x and y in the base frame as far as it is known, tared. The standard error holds the
    scatter of a bootstrap over blocks of a second, what another elastic law, point of touch or low-pass would change,
    and half a millisecond. ``how="refused"`` with the reason where the offset cannot be determined.
    """
    steps = round(window_s / _STEP_S)
    shifts = np.arange(-steps, steps + 1, dtype=np.float64) * _STEP_S
    origin = int(force_ns[0])
    time = (frame_ns - origin).astype(np.float64) * 1e-9
    end = (int(force_ns[-1]) - origin) * 1e-9
    usable = np.isfinite(coordinates).all(axis=1) & (time > window_s) & (time < end - window_s)
    if usable.sum() < 50 or time[usable][-1] - time[usable][0] < 3.0:
        return _refused(f"only {int(usable.sum())} frames show the catheter while the force log runs; 3 s are needed")
    blocks = _blocks(time, usable)
    data = Data(time[usable], coordinates[usable], blocks, Force(force_ns, force_n[:, :2], origin)).touching()
    free = Fit(data, shifts, 0.0, bound=False)
    for _ in range(3):  # images in which something else was detected
        rest = np.abs(free.residuals(free.best()))
        # what is usual is told from frames in contact: without it nothing is left to explain, and all seems outlying
        usual = float(np.median(rest[data.loaded()]))
        keep = rest <= 6.0 * max(usual, 1e-12)
        if keep.all():
            break
        data = data.subset(keep)
        free = Fit(data, shifts, 0.0, bound=False)
    penalty = Fit(data, shifts, 0.0, bound=True).penalty()
    fit = Fit(data, shifts, penalty, bound=False)
    note = ""
    turn = math.degrees(free.angle(free.best()))
    if abs(turn) > _MAX_TURN_DEG and free.unexplained() < _FREE_GAIN * fit.unexplained():
        fit, penalty = free, 0.0
        note = f"force and deflection agree only if the sensor is turned by {turn:.0f} deg more than stated"
    elif fit.slope(fit.best()) < 0:
        note = "the deflection goes against the force: check the sensor's angle and whether it reads tip-on-tissue"
    verdict = _judge(fit, shifts, fit.best(), fit.explained(fit.best()), window_s)
    if verdict.how == "refused":
        return verdict
    fine = np.arange(-16, 17, dtype=np.float64) * 1e-3 + fit.best()  # the coarse parabola is off by tenths of one
    best_s = Fit(data, fine, penalty, bound=False).best()
    others = [Fit(data, fine, penalty, bound=False, degree=degree).best() for degree in _OTHER_DEGREES]
    others.append(Fit(data.touching(-1.0), fine, penalty, bound=False).best())
    sharper = replace(data, force=Force(force_ns, force_n[:, :2], origin, 0.5 * SMOOTH_S))
    others.append(Fit(sharper, fine, penalty, bound=False).best())
    law_ms = 0.5e3 * float(np.ptp([best_s, *others]))
    stderr_ms = math.hypot(verdict.stderr_ms, law_ms, _FLOOR_MS)
    if stderr_ms > _MAX_STDERR_MS:
        return _refused(_uncertain(best_s, stderr_ms), verdict.explained)
    return replace(verdict, offset_ns=_microsecond(best_s), stderr_ms=round(stderr_ms, 3), detail=note)


def _blocks(time: FloatArray, usable: npt.NDArray[np.bool_]) -> IntArray:
    """The second that each usable frame belongs to; of long recordings evenly spread seconds only (in place)."""
    seconds = np.floor(time / _BLOCK_S).astype(np.int64)
    stride = -(-len(np.unique(seconds[usable])) // _MAX_BLOCKS)
    usable &= seconds % stride == 0
    return seconds[usable]


def _judge(fit: Fit, shifts: FloatArray, best: float, explained: float, window_s: float) -> ClockOffset:
    if explained < _MIN_EXPLAINED:
        return _refused(
            f"the force explains {100 * max(explained, 0.0):.0f} % of the deflection ({100 * _MIN_EXPLAINED:.0f} % are "
            "needed): too little contact or motion",
            explained,
        )
    if abs(best) > window_s - 2 * _STEP_S:
        return _refused(f"the best offset lies at the edge of +-{1e3 * window_s:.0f} ms", explained)
    even = np.full(fit.count, 1.0 / fit.count)
    weights = np.random.default_rng(0).multinomial(fit.count, even, _REPLICATES).astype(np.float64)
    places = peak(shifts, fit.profile(weights))
    apart = np.abs(places - best) > _RIVAL_S
    if apart.mean() > 0.05:
        rival = float(np.median(places[apart]))
        return _refused(
            f"{1e3 * best:.0f} ms and {1e3 * rival:.0f} ms fit alike: the motion repeats itself or is too little",
            explained,
        )
    stderr_ms = 1e3 * float(np.std(places[~apart]))
    if stderr_ms > _MAX_STDERR_MS:
        return _refused(_uncertain(best, stderr_ms), explained)
    return ClockOffset(_microsecond(best), "estimated", round(stderr_ms, 3), round(explained, 6))


def _microsecond(seconds: float) -> int:
    """In nanoseconds, to the microsecond: nothing finer is known."""
    return 1000 * round(seconds * 1e6)


def _uncertain(best_s: float, stderr_ms: float) -> str:
    return f"{1e3 * best_s:.0f} ms fits best, but only to +-{stderr_ms:.0f} ms (standard error): too little motion"


def _refused(reason: str, explained: float = math.nan) -> ClockOffset:
    return ClockOffset(0, "refused", explained=round(explained, 6), detail=reason)
