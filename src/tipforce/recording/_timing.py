"""The offset between the force log's clock and the camera's, from the catheter's own deflection.

An elastic shaft takes its shape at once: shape and force belong to the same instant, friction and contact or not. The
bending moment at s is the lever from s to the tip times the force, and both lever and bend are in the picture. So

    B = c0 + c1 G + c2 G^2 + c3 G^3,    B = integral w(s) dtheta,    G(t) = integral w(s) [lever(s) x F(t)]_z ds,

with theta the shaft's angle, w a bell over the part that bends and c's that hold the unknown stiffness. The force is
shifted by trial offsets; the most likely one leaves the smallest residual. A free regression on both components of the
force is worse by milliseconds: friction goes with the wall's velocity, so its coefficient can stand for a shift in
time. Physics binds the two components, up to an error of the sensor's angle that is fitted with a prior of two degrees.

The bell keeps out what is seen badly: w and its slope vanish at both ends, so no single point of the centreline counts
for much, and the dome, where one flank turns into the other, does not count at all but for the lever. The levers are
turned by one angle for all pictures, for the seen base turns with the bend and the sensor does not. They end where a
ball of the shaft's diameter touches a wall that lies across the mean force.

The motion of the wall would not do at all: it leads the force by the tissue's loss angle. A drift of 20 ppm between
the clocks is 1.2 ms in 60 s and is left alone; in a recording of many minutes the offset is the one of its middle.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from ..types import BasePose, FloatArray, IntArray
from ..vision import Sighting
from ._facts import ClockOffset

__all__ = ["estimate_offset", "shape_coordinates"]

_STEP_S = 4e-3
_SMOOTH_S = 10e-3
"""Standard deviation of the force's low-pass: symmetric, so it moves nothing in time. The force's noise pulls the
answer late (3 mN and steps of 5 mN at 1 kHz: by 0.7 ms with 2 ms, 0.3 with 4); 24 ms round off touch and release.
"""
_BLOCK_S = 1.0
_MAX_BLOCKS = 150
_REPLICATES = 100
_MIN_EXPLAINED = 0.3
_MAX_STDERR_MS = 5.0
_RIVAL_S = 0.025
_DEGREE, _OTHER_DEGREES = 3, (2, 5)
"""Of the elastic law; what others would give tells how much the answer hangs on that choice."""
_FLOOR_MS = 0.5
"""What no cross-check shows: bend and levers are seen with errors of a few hundredths of a pixel; the tare drifts."""
_SEEN_WELL = 0.9
"""Of the shaft's length: the rest is the dome, seen five times worse."""
_ANGLE_PRIOR = math.tan(math.radians(2.0))
_MAX_TURN_DEG, _FREE_GAIN = 10.0, 0.7
"""The stated angle is taken for wrong where another, further off than this, leaves less than this share unexplained."""


def shape_coordinates(sightings: Sequence[Sighting], *, flexible_share: float = 1.0) -> FloatArray:
    """(n, 4): B in rad; what multiplies the force's x and y in G, in px; how the lever's end weighs in them, in px.

    NaN where nothing was found. ``flexible_share``: of the visible length, from the base; a rigid tip does not bend.
    The base frame's direction is the median one. The lever ends in the middle of the dome; the last column is the
    dome's radius times the integral of w.
    """
    rows = np.full((len(sightings), 4), math.nan)
    turns = np.array([np.exp(1j * sighting.base.angle_rad) for sighting in sightings if sighting.base is not None])
    if turns.size == 0:
        return rows
    middle = complex(turns.mean())
    angle_rad = float(np.angle(middle) + np.median(np.angle(turns * middle.conjugate())))
    end = min(flexible_share, _SEEN_WELL)
    diameters = np.array([sighting.diameter_px for sighting in sightings])
    known = diameters[np.isfinite(diameters)]
    radius = 0.5 * float(np.median(known)) if known.size else 0.0
    for place, sighting in enumerate(sightings):
        if sighting.centreline is None or sighting.base is None:
            continue
        points = BasePose(sighting.base.origin_px, angle_rad).to_base(sighting.centreline.points)
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


def estimate_offset(
    frame_ns: IntArray, coordinates: FloatArray, force_ns: IntArray, force_n: FloatArray, *, window_s: float = 0.3
) -> ClockOffset:
    """The offset within +-``window_s`` at which force and deflection belong together best.

    ``frame_ns`` (n,), ``coordinates`` (n, 4) of `shape_coordinates`, rows with NaN are left out; ``force_ns`` (m,),
    ``force_n`` (m, 2 or more): x and y in the base frame as far as it is known, tared. The standard error holds the
    scatter of a bootstrap over blocks of a second, what another elastic law, point of touch or low-pass would change,
    and half a millisecond. ``how="refused"`` with the reason where the offset cannot be told.
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
    data = _Data(time[usable], coordinates[usable], blocks, _Force(force_ns, force_n[:, :2], origin)).touching()
    free = _Fit(data, shifts, 0.0, bound=False)
    for _ in range(3):  # pictures in which something else was seen
        rest = np.abs(free.residuals(free.best()))
        # what is usual is told from frames in contact: without it nothing is left to explain, and all seems outlying
        usual = float(np.median(rest[data.loaded()]))
        keep = rest <= 6.0 * max(usual, 1e-12)
        if keep.all():
            break
        data = data.subset(keep)
        free = _Fit(data, shifts, 0.0, bound=False)
    penalty = _Fit(data, shifts, 0.0, bound=True).penalty()
    fit = _Fit(data, shifts, penalty, bound=False)
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
    best_s = _Fit(data, fine, penalty, bound=False).best()
    others = [_Fit(data, fine, penalty, bound=False, degree=degree).best() for degree in _OTHER_DEGREES]
    others.append(_Fit(data.touching(-1.0), fine, penalty, bound=False).best())
    sharper = replace(data, force=_Force(force_ns, force_n[:, :2], origin, 0.5 * _SMOOTH_S))
    others.append(_Fit(sharper, fine, penalty, bound=False).best())
    law_ms = 0.5e3 * float(np.ptp([best_s, *others]))
    stderr_ms = math.hypot(verdict.stderr_ms, law_ms, _FLOOR_MS)
    if stderr_ms > _MAX_STDERR_MS:
        return _refused(_doubtful(best_s, stderr_ms), verdict.explained)
    return replace(verdict, offset_ns=_microsecond(best_s), stderr_ms=round(stderr_ms, 3), detail=note)


class _Force:
    """The force on an even grid, low-passed; x and y, NaN taken as none."""

    def __init__(self, stamps_ns: IntArray, force: FloatArray, origin_ns: int, smooth_s: float = _SMOOTH_S) -> None:
        seconds = (stamps_ns - origin_ns) * 1e-9
        step = max(float(np.median(np.diff(seconds))), 1e-4)
        self._grid = np.arange(0.0, seconds[-1] + step, step)
        even = np.stack([np.interp(self._grid, seconds, column) for column in np.nan_to_num(force).T])
        self._values = gaussian_filter1d(even, max(smooth_s / step, 1e-3), axis=1)

    @property
    def direction(self) -> FloatArray:
        """(2,): of the mean force, each instant weighing as its size; zero where there is none."""
        total = self._values @ np.linalg.norm(self._values, axis=0)
        return total / max(float(np.linalg.norm(total)), 1e-12)

    def at(self, seconds: FloatArray) -> FloatArray:
        """(...) -> (2, ...)."""
        return np.stack([np.interp(seconds, self._grid, row) for row in self._values])


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    """Frames: ``time`` (n,) s, ``coordinates`` (n, 4), ``blocks`` (n,); and the force."""

    time: FloatArray
    coordinates: FloatArray
    blocks: IntArray
    force: _Force

    def touching(self, way: float = 1.0) -> "_Data":
        """The levers' end moved by the dome's radius against the mean force, to where the wall is met; -1: and back."""
        x, y = way * self.force.direction
        moved = self.coordinates.copy()
        moved[:, 1] += y * moved[:, 3]
        moved[:, 2] -= x * moved[:, 3]
        return replace(self, coordinates=moved)

    def subset(self, keep: npt.NDArray[np.bool_]) -> "_Data":
        """Some of the frames."""
        return _Data(self.time[keep], self.coordinates[keep], self.blocks[keep], self.force)

    def loaded(self) -> npt.NDArray[np.bool_]:
        """(n,): the half of the frames at which the force is larger."""
        size = np.linalg.norm(self.force.at(self.time), axis=0)
        return size >= np.median(size)

    def terms(self, shifts: FloatArray, rows: npt.NDArray[np.bool_] | slice, *, bound: bool, degree: int) -> FloatArray:
        """(shifts, n, terms): 1, G, G^2 ... and, unless ``bound``, what G gains when the sensor turns."""
        # a force stamp is the frame's time minus the offset
        x, y = self.force.at(self.time[rows] - shifts[:, None])
        across, along = self.coordinates[rows, 1], self.coordinates[rows, 2]
        unit = max(
            float(np.std(self.force.at(self.time), axis=1).max() * np.abs(self.coordinates[:, 1:3]).max()), 1e-12
        )
        lever = (across * x + along * y) / unit
        columns = [lever**power for power in range(degree + 1)]
        if not bound:
            columns.append((along * x - across * y) / unit)
        return np.stack(columns, axis=-1)


class _Fit:
    """Sums of the regression, block by block, for every trial shift: all that profile and bootstrap need."""

    def __init__(self, data: _Data, shifts: FloatArray, penalty: float, *, bound: bool, degree: int = _DEGREE) -> None:
        self._data, self._shifts, self._penalty, self._bound, self._degree = data, shifts, penalty, bound, degree
        self._c = data.coordinates[:, 0] - data.coordinates[:, 0].mean()
        numbers, self._block = np.unique(data.blocks, return_inverse=True)
        self.count = len(numbers)
        xx: list[FloatArray] = []
        xc: list[FloatArray] = []
        for number in range(self.count):
            here = self._block == number
            x = data.terms(shifts, here, bound=bound, degree=degree)
            xx.append(np.swapaxes(x, 1, 2) @ x)
            xc.append(np.swapaxes(x, 1, 2) @ self._c[here])
        self._xx, self._xc = np.array(xx), np.array(xc)
        self._cc = np.bincount(self._block, self._c**2)

    def profile(self, weights: FloatArray) -> FloatArray:
        """(r, blocks) weights -> (r, shifts): minus the logarithm of what is left unexplained."""
        rows: list[FloatArray] = []
        for weight in weights:
            xx, xc = np.tensordot(weight, self._xx, 1), np.tensordot(weight, self._xc, 1)
            places = np.arange(xx.shape[1])
            xx[:, places, places] *= 1.0 + 1e-9
            xx[:, places, places] += 1e-9
            if not self._bound:
                xx[:, -1, -1] += self._penalty
            taken = np.sum(xc * np.linalg.solve(xx, xc[..., None])[..., 0], axis=1)
            rows.append(-np.log(np.maximum(weight @ self._cc - taken, 1e-30)))
        return np.array(rows)

    def best(self) -> float:
        """The most likely shift."""
        return float(_peak(self._shifts, self.profile(np.ones((1, self.count))))[0])

    def _solve(self, shift: float) -> tuple[FloatArray, FloatArray]:
        x = self._data.terms(np.array([shift]), slice(None), bound=self._bound, degree=self._degree)[0]
        xx = x.T @ x + 1e-9 * np.eye(x.shape[1])
        if not self._bound:
            xx[-1, -1] += self._penalty
        return x, np.linalg.solve(xx, x.T @ self._c)

    def residuals(self, shift: float) -> FloatArray:
        """(n,): bend that is left unexplained, rad."""
        x, solved = self._solve(shift)
        return self._c - x @ solved

    def explained(self, shift: float) -> float:
        """Share of the bend's variance that the force explains."""
        return float(1.0 - self.residuals(shift).var() / max(float(self._c.var()), 1e-30))

    def unexplained(self) -> float:
        """Variance that is left at the most likely shift."""
        return float(self.residuals(self.best()).var())

    def slope(self, shift: float) -> float:
        """Sign and size of dB/dG, by the straight line through what is fitted: positive for a real shaft."""
        x, solved = self._solve(shift)
        lever, fitted = x[:, 1] - x[:, 1].mean(), x[:, : self._degree + 1] @ solved[: self._degree + 1]
        return float(lever @ fitted / max(float(lever @ lever), 1e-30))

    def angle(self, shift: float) -> float:
        """By how much the sensor seems turned, rad; of a fit that is not bound."""
        return math.atan2(float(self._solve(shift)[1][-1]), self.slope(shift))

    def penalty(self) -> float:
        """What the prior on the angle adds to the squares: residual variance over (slope times tan 2 deg)^2."""
        at = self.best()
        return float(self.residuals(at).var() / max((self.slope(at) * _ANGLE_PRIOR) ** 2, 1e-12))


def _blocks(time: FloatArray, usable: npt.NDArray[np.bool_]) -> IntArray:
    """The second that each usable frame belongs to; of long recordings evenly spread seconds only (in place)."""
    seconds = np.floor(time / _BLOCK_S).astype(np.int64)
    stride = -(-len(np.unique(seconds[usable])) // _MAX_BLOCKS)
    usable &= seconds % stride == 0
    return seconds[usable]


def _peak(shifts: FloatArray, profiles: FloatArray) -> FloatArray:
    """Place of each profile's (r, shifts) maximum, by the parabola through its three highest points."""
    top = np.clip(np.argmax(profiles, axis=1), 1, len(shifts) - 2)
    rows = np.arange(len(profiles))
    left, middle, right = profiles[rows, top - 1], profiles[rows, top], profiles[rows, top + 1]
    bend = left - 2 * middle + right
    move = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1.0), 0.0)
    return shifts[top] + np.clip(move, -1.0, 1.0) * (shifts[1] - shifts[0])


def _judge(fit: _Fit, shifts: FloatArray, best: float, explained: float, window_s: float) -> ClockOffset:
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
    places = _peak(shifts, fit.profile(weights))
    apart = np.abs(places - best) > _RIVAL_S
    if apart.mean() > 0.05:
        rival = float(np.median(places[apart]))
        return _refused(
            f"{1e3 * best:.0f} ms and {1e3 * rival:.0f} ms fit alike: the motion repeats itself or is too little",
            explained,
        )
    stderr_ms = 1e3 * float(np.std(places[~apart]))
    if stderr_ms > _MAX_STDERR_MS:
        return _refused(_doubtful(best, stderr_ms), explained)
    return ClockOffset(_microsecond(best), "estimated", round(stderr_ms, 3), round(explained, 6))


def _microsecond(seconds: float) -> int:
    """In nanoseconds, to the microsecond: nothing finer is known."""
    return 1000 * round(seconds * 1e6)


def _doubtful(best_s: float, stderr_ms: float) -> str:
    return f"{1e3 * best_s:.0f} ms fits best, but only to +-{stderr_ms:.0f} ms (standard error): too little motion"


def _refused(reason: str, explained: float = math.nan) -> ClockOffset:
    return ClockOffset(0, "refused", explained=round(explained, 6), detail=reason)
