"""Inertia of the load in the readings of a sensor on a moving stage, removed by the commands of the stage.

The sensor carries tissue and plate. While the stage moves out of the tip's reach, its readings are

    F(t) = level + sum over axes of k_axis a_axis(t + lag),

with the accelerations a of the stage's commanded positions. The fit gives the level (the tare), a vector k for each
axis (the carried mass times the axis's direction in the sensor's frame) and the lag between the force log's clock and
the stage's movement, the sum of all delays. The same sum is then subtracted from every reading.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import InputError
from ..io import Inertia, Tare
from ..types import FloatArray, IntArray
from ..vision import DetectedShape

_GRID_S = 0.01
_WINDOW, _DEGREE = 9, 4
"""Points and degree of the polynomial whose second derivative is the acceleration."""
_BIN_S = 4e-3
"""Readings are averaged over this time; it is also the step of the lags that are tried."""
_EDGE_S = 0.05
"""At the start of the stage's log its acceleration is not known well for this time."""
_MIN_GAIN = 60.0
"""Smallest decrease of the sum of squares by the fit, in variances of a binned reading; with less, the stage's movement
is not detected: some ten for each fitted number, because many lags are tried. A mass with 1.7 mN in noise of 3 mN
still turns the force on a nearly straight shaft by a tenth.
"""
_TABLE = 4096
"""Instants of a beat."""
_RATE_STEP_S, _AROUND_S = 0.02, 0.1
"""Readings are averaged over the first, and compared with the stage at the second before and after."""
_TIP_BIN_S, _MAX_TIP_STEP_S, _MIN_TIP_BINS = 40e-3, 0.1, 50
"""The tip's positions are averaged over the first; neighbours further apart than the second count for nothing."""
_FASTEST = 99.0
"""Percentile of the accelerations above which something else was detected."""
_CROOKED = 0.03
"""Standard deviation allowed to the axes' being perpendicular and carrying one mass."""


class StageMotion:
    """The stage's commanded positions as accelerations.

    Args:
        stamp_ns: (m,) stamps on the recording's clock.
        positions: name -> (m,) positions in m or, if the name ends in _mm, in mm.
    """

    def __init__(self, stamp_ns: IntArray, positions: Mapping[str, FloatArray]) -> None:
        """Differentiates the positions twice on an even grid; see the class."""
        self.names = tuple(positions)
        self.start_ns = int(stamp_ns[0]) if len(stamp_ns) else 0
        seconds = (stamp_ns - self.start_ns) * 1e-9
        count = 1 + round(seconds[-1] / _GRID_S) if len(stamp_ns) else 0
        self._grid: FloatArray = np.arange(count, dtype=np.float64) * _GRID_S
        self._values = np.zeros((len(self.names), count))
        if count >= _WINDOW:
            from scipy.signal import savgol_filter  # a slow import, and most sessions have no stage

            for axis, (name, values) in enumerate(positions.items()):
                metres = np.interp(self._grid, seconds, values) * (1e-3 if name.endswith("_mm") else 1.0)
                self._values[axis] = savgol_filter(metres, _WINDOW, _DEGREE, deriv=2, delta=_GRID_S)

    @classmethod
    def of(cls, readings: Sequence[tuple[int, Mapping[str, float]]]) -> "StageMotion":
        """Makes the motion from (stamp, positions by name), reading by reading; the names are the first one's."""
        names = readings[0][1] if readings else {}
        return cls(
            np.array([stamp for stamp, _ in readings], np.int64),
            {name: np.array([values[name] for _, values in readings]) for name in names},
        )

    def acceleration(self, stamp_ns: IntArray, axes: Sequence[str]) -> FloatArray:
        """Returns the accelerations of the stage.

        Args:
            stamp_ns: (n,) stamps on the stage's clock.
            axes: names of the axes.

        Returns:
            (n, axes) accelerations in m/s^2; 0 outside of the stage's time.
        """
        seconds = (stamp_ns - self.start_ns) * 1e-9
        rows = [np.interp(seconds, self._grid, self._values[self.names.index(axis)], 0.0, 0.0) for axis in axes]
        return np.stack(rows, axis=-1) if rows else np.zeros((len(stamp_ns), 0))


def carried_n(stage: StageMotion, inertia: Inertia, stamps_ns: IntArray) -> FloatArray:
    """Returns the inertia of the carried mass in readings.

    Args:
        stage: movement of the stage.
        inertia: gains, lag and beat of the inertia.
        stamps_ns: (n,) stamps of the readings.

    Returns:
        (n, 3) force in N, in the frame of the readings; (3,) zeros without inertia.
    """
    carried: FloatArray = np.zeros(3)
    if inertia.axes:
        carried = stage.acceleration(inertia.stage_ns(stamps_ns), inertia.axes) @ inertia.gain_kg
    if inertia.beat_hz:
        carried = carried + _beat_n(inertia, stamps_ns)
    return carried


def _beat_n(inertia: Inertia, stamps_ns: IntArray) -> FloatArray:
    """Returns the force (n, 3) of the harmonics at ``stamps_ns`` in N, from a table over one beat."""
    cycles = np.linspace(0.0, 1.0, _TABLE)
    turns = 2.0 * math.pi * np.outer(cycles, np.arange(1, len(inertia.beat_n) + 1))
    table = np.cos(turns) @ inertia.beat_n[:, 0] + np.sin(turns) @ inertia.beat_n[:, 1]
    at = np.remainder((stamps_ns - inertia.reference_ns) * 1e-9 * inertia.beat_hz, 1.0)
    return np.stack([np.interp(at, cycles, column) for column in table.T], axis=1)


def fit_inertia(
    stamps_ns: IntArray,
    force_n: FloatArray,
    stage: StageMotion,
    stretch_s: tuple[float, float],
    *,
    window_s: float = 0.3,
    rate: float = 1.0,
    lag_ns: int = 0,
) -> tuple[Tare, Inertia]:
    """Fits tare and inertia in a contact-free stretch.

    Args:
        stamps_ns: (n,) stamps of the readings.
        force_n: (n, 3) readings in N, not corrected.
        stage: movement of the stage.
        stretch_s: start and end of the stretch in seconds since the log's first row.
        window_s: lags up to this far from ``lag_ns`` are tried.
        rate: rate of the stage's clock.
        lag_ns: nominal lag of the stage's clock in the middle of the stretch.

    Returns:
        Tare and inertia. Where the readings do not show the stage's movement, the inertia has ``how="none"`` with the
        reason, and the tare is the mean of the readings.

    Raises:
        InputError: the stretch has less than a second of readings.
    """
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    axes = ~np.isnan(force_n).all(axis=0)
    inside = (seconds >= stretch_s[0]) & (seconds <= stretch_s[1]) & np.isfinite(force_n[:, axes]).all(axis=1)
    span = float(np.ptp(seconds[inside])) if inside.any() else 0.0
    if span < 1.0:
        raise InputError(
            f"tare=({stretch_s[0]:g}, {stretch_s[1]:g}): has {span:.2f} s of readings, and the stage's inertia "
            f"needs one second; the force log runs from 0 to {seconds[-1]:.1f} s"
        )
    # means of the readings (bins, k), at stage times (bins,) by the nominal lag
    number = np.floor((seconds[inside] - seconds[inside][0]) / _BIN_S).astype(np.int64)
    _, bin_of, counts = np.unique(number, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(bin_of, column) / counts for column in force_n[inside][:, axes].T], axis=1)
    bin_ns = np.bincount(bin_of, (stamps_ns[inside] - stamps_ns[0]).astype(np.float64)) / counts
    middle_ns = int(stamps_ns[0]) + round(0.5e9 * sum(stretch_s))
    nominal = Inertia(lag_ns=lag_ns, rate=rate, reference_ns=middle_ns)
    stage_ns = nominal.stage_ns(stamps_ns[0] + np.round(bin_ns).astype(np.int64))
    logged = stage_ns >= stage.start_ns + round((window_s + _EDGE_S) * 1e9)  # by the stage, at every lag that is tried
    if logged.sum() * _BIN_S >= 0.5 * span:
        stage_ns, means = stage_ns[logged], means[logged]

    def fit(lag_s: float) -> tuple[FloatArray, float]:
        """Returns level and gains (1 + axes, k), and the sum of the squared residuals."""
        accelerations = stage.acceleration(stage_ns + round(lag_s * 1e9), stage.names)
        columns = np.column_stack([np.ones(len(stage_ns)), accelerations])
        solved: FloatArray = np.linalg.lstsq(columns, means, rcond=1e-6)[0].astype(np.float64)
        return solved, float(np.sum((means - columns @ solved) ** 2))

    lags = np.arange(-round(window_s / _BIN_S), round(window_s / _BIN_S) + 1) * _BIN_S
    tried = [fit(lag) for lag in lags]
    sums = np.array([loss for _, loss in tried])
    losses = sums * means.size / max(float(sums.min()), 1e-30) + np.array([_crookedness(s[1:]) for s, _ in tried])
    best = int(np.argmin(losses))
    lag_s = float(lags[best])
    if 0 < best < len(lags) - 1:  # minimum of the parabola through the best lag and its neighbours
        before, here, after = losses[best - 1 : best + 2]
        lag_s += _BIN_S * 0.5 * float((before - after) / max(before - 2 * here + after, 1e-30))
    solved, loss = fit(lag_s)
    level_loss = float(np.sum((means - means.mean(axis=0)) ** 2))  # of a level without inertia
    level, stderr, gains = np.zeros(3), np.full(3, math.nan), np.zeros((len(stage.names), 3))
    if level_loss - loss < _MIN_GAIN * loss / means.size:
        solved[0], solved[1:], loss = means.mean(axis=0), 0.0, level_loss
    level[axes], gains[:, axes] = solved[0], solved[1:]
    # residuals are not independent within a beat: one degree of freedom for each half second
    stderr[axes] = np.sqrt(loss / means.size / max(1.0, span / 0.5))
    tare = Tare(level, stderr, (stretch_s,), "stated")
    if not gains.any():
        return tare, Inertia(detail="the readings do not show the stage's movement: no inertia is taken out")
    lag_ns += 1000 * round(lag_s * 1e6)  # nothing finer than a microsecond is known
    return tare, Inertia(stage.names, gains, lag_ns, "estimated", rate=rate, reference_ns=middle_ns)


def best_inertia(stamps_ns: IntArray, force_n: FloatArray, stage: StageMotion, found: Sequence[Inertia]) -> Inertia:
    """Returns the inertia whose clock map between force log and stage holds for the whole log.

    Contact and inertia both follow the stage's movement, so all readings are regressed on its accelerations now, a
    little before and a little after; the right map leaves least.

    Args:
        stamps_ns: (n,) stamps of the readings.
        force_n: (n, 3) readings in N; NaN where there is no plausible reading.
        stage: movement of the stage on its own clock.
        found: one inertia or more, to choose from.
    """
    axes = ~np.isnan(force_n).all(axis=0)
    step = max(1, round(_RATE_STEP_S * 1e9 / max(float(np.median(np.diff(stamps_ns))), 1.0)))
    finite = np.flatnonzero(np.isfinite(force_n[:, axes]).all(axis=1))
    count = len(finite) // step * step
    means = force_n[finite[:count]][:, axes].reshape(-1, step, int(axes.sum())).mean(axis=1)
    middle_ns = stamps_ns[finite[:count]].reshape(-1, step)[:, step // 2]
    losses: list[float] = []
    for inertia in found:
        stage_ns = inertia.stage_ns(middle_ns)
        times = (stage_ns + round(1e9 * side * _AROUND_S) for side in (-1.0, 0.0, 1.0))
        columns = np.column_stack([np.ones(len(means)), *(stage.acceleration(time, stage.names) for time in times)])
        solved = np.linalg.lstsq(columns, means, rcond=1e-6)[0]
        losses.append(float(np.sum((means - columns @ solved) ** 2)))
    return found[int(np.argmin(losses))]


def tip_acceleration(time_ns: IntArray, shapes: Sequence[DetectedShape], metres_per_px: float) -> float:
    """Returns the RMS acceleration of the catheter's tip, m/s^2: about that of the wall that pushes it.

    In 40 simulated sessions it gave the inertia of the mass behind the wall to 25 % where that was above 15 mN, and too
    much by up to 6 mN where it was less.

    Args:
        time_ns: (n,) when each image was taken, in true nanoseconds.
        shapes: (n) detected in the images.
        metres_per_px: scale of the images.

    Returns:
        0 where too little of the tip was detected.
    """
    if len(shapes) != len(time_ns):
        return 0.0
    timed_tips = [(ns, s.centreline.points[-1]) for ns, s in zip(time_ns.tolist(), shapes, strict=True) if s.centreline]
    if len(timed_tips) < _MIN_TIP_BINS:
        return 0.0
    seconds = np.array([ns - timed_tips[0][0] for ns, _ in timed_tips]) * 1e-9
    tips = np.array([tip for _, tip in timed_tips]) * metres_per_px
    _, bin_of, counts = np.unique(np.floor(seconds / _TIP_BIN_S), return_inverse=True, return_counts=True)
    middle, x, y = (np.bincount(bin_of, values) / counts for values in (seconds, *tips.T))
    step = np.diff(middle)
    speed = np.diff(np.stack([x, y], axis=1), axis=0) / step[:, None]
    acceleration = 2.0 * np.diff(speed, axis=0) / (step[1:] + step[:-1])[:, None]
    acceleration = acceleration[np.maximum(step[1:], step[:-1]) < _MAX_TIP_STEP_S]
    if len(acceleration) < _MIN_TIP_BINS:
        return 0.0
    squares = np.sum(acceleration**2, axis=1)
    return math.sqrt(float(squares[squares <= np.percentile(squares, _FASTEST)].mean()))


def _crookedness(gains: FloatArray) -> float:
    """Returns how far ``gains`` (axes, k) are from one mass on perpendicular axes, in standard deviations squared.

    Two axes that move with the same frequency can take over each other's part at a wrong lag; one mass cannot.
    """
    gram = gains @ gains.T
    mass = float(np.trace(gram)) / max(1, len(gram))
    difference = gram / max(mass, 1e-30) - np.eye(len(gram))
    return float(np.sum(difference**2)) / _CROOKED**2
