"""Checks a force log for clipped, dead, spiking and missing readings, and for readings that the sensor refused."""

import math

import numpy as np
import numpy.typing as npt

from ..types import BoolArray, FloatArray, IntArray
from ._findings import MAX_GAP_S, FindingKind, ForceFinding, ForcePlausibility, stretches
from ._noise import AxisNoise, axis_noise, run_lengths

_MIN_READINGS = 100
"""Fewest readings in which noise and plateaus can be found."""
_MIN_CLIPPED = 10
_LIMIT_SHARE = 0.999
"""A reading of at least this share of the range of the data sheet is clipped."""
MIN_CLIPPED_RATIO = 4.0
"""A clipped axis has at least this ratio of readings at its extreme value to readings just below."""
MIN_MOVING_STEPS, MIN_MOVING_NOISES, MIN_MOVING_SHARE = 4.0, 10.0, 0.2
"""Where the noise is too small to be measured, a plateau is clipping only if another axis moves in it by more than this
number of steps, this number of standard deviations of its noise, and this share of its range."""
MIN_SPIKE_NOISES, MIN_SPIKE_SHARE, MIN_SLOW_SPIKE_SHARE = 30.0, 0.2, 1.0
"""Smallest height of a spike of one or two readings: in standard deviations of the noise, and as a share of the range
of the axis (0.5 % to 99.5 %). In clean simulated sessions at 1 kHz the motion of the stage gives up to 20 and 0.13. In
a slow log it lasts as long as one reading, and the larger share applies."""
MAX_FAST_PERIOD_S = 2.5e-3
"""Longest time between the readings of a fast log."""
MAX_RETURN_SHARE = 0.25
"""The readings before and after a spike differ by at most this share of its height."""
MIN_OUTLIER_RANGES = 5.0
"""A reading farther than this number of ranges from the range of the axis is a spike of any duration."""
MAX_SPIKE_SHARE = 0.01
"""Largest share of spikes among the readings; a more frequent pattern is no spike."""
_MIN_DEAD_VALUES = 10
"""An axis that never changes is dead where another one takes at least this number of values."""
_NO_STATUS = 'if the column holds no error status, state sensor.log.status = "" in bench.toml'
MIN_GAP_STEPS = 2.5
"""A step in time that is longer than this number of usual ones is a gap."""


def check_force_log(
    stamps_ns: IntArray,
    force_n: FloatArray,
    *,
    status: IntArray | None = None,
    range_n: tuple[float, float, float] | None = None,
) -> ForcePlausibility:
    """Finds the readings of a force log, or of a stretch of a live stream, that must not be used.

    Args:
        stamps_ns: (n,) stamps of the readings, rising.
        force_n: (n, 3) readings in the sensor's frame, N; a column of NaN is an axis that the sensor lacks.
        status: (n,) status words of the sensor; every value but 0 is an error.
        range_n: (3,) largest reading of each axis by the sensor's data sheet, N.

    Returns:
        Findings, the readings that are not used, and the number of gaps. `find_zero_steps` finds the steps of the zero,
        after the inertia of the mass on the sensor was subtracted.
    """
    if not len(stamps_ns):
        return ForcePlausibility()
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    axes = np.flatnonzero(~np.isnan(force_n).all(axis=0)).tolist()
    findings: list[ForceFinding] = []
    bad = np.zeros(len(stamps_ns), np.bool_)

    def add(kind: FindingKind, rows: BoolArray, axes: str, size: float = math.nan, detail: str = "") -> None:
        # a reading counts in the first finding that covers it
        fresh = rows & ~bad
        bad[rows] = True
        for first, last in stretches(rows, seconds):
            count = int(fresh[first : last + 1].sum())
            findings.append(ForceFinding(kind, seconds[first], seconds[last], axes, size, count, detail))

    if status is not None:
        refused = status != 0
        words = ", ".join(hex(word) if word > 9 else str(word) for word in np.unique(status[refused])[:3].tolist())
        add(
            "error status",
            refused,
            "".join("xyz"[axis] for axis in axes),
            detail=f"the status is {words} ({_NO_STATUS})",
        )
    missing = np.isnan(force_n[:, axes]).any(axis=1) & ~bad
    bad |= missing
    sound = np.flatnonzero(~bad)  # rows of the readings that the sensor measured; `known` are their forces
    dead: list[int] = []
    if len(sound) >= _MIN_READINGS:
        known = force_n[sound]
        noises = {axis: axis_noise(known[:, axis]) for axis in axes}
        dead = _dead(known, axes)
        share = MIN_SLOW_SPIKE_SHARE if np.median(np.diff(seconds)) > MAX_FAST_PERIOD_S else MIN_SPIKE_SHARE
        living = [axis for axis in axes if axis not in dead]
        for axis in living:
            letter, values, noise = "xyz"[axis], known[:, axis], noises[axis]
            spikes, height = _spikes(values, noise, share)
            add("spike", _rows(sound[spikes], bad), letter, height, f"f{letter} deviates by {height:.3g} N")
            others = {each: known[:, each] for each in living if each != axis}
            plateau, level = _clipped(values, noise, others, noises, spikes, range_n[axis] if range_n else math.inf)
            detail = f"f{letter} stays at {level:.4g} N, the end of its range"
            add("clipped", _rows(sound[plateau], bad), letter, level, detail)
            still = _stuck(values, noise) & ~plateau
            add("dead axis", _rows(sound[still], bad), letter, detail=f"f{letter} repeats one value for too long")
        for axis in dead:
            detail = f"f{'xyz'[axis]} is {known[0, axis]:.4g} N in every row, so this axis gives no labels"
            findings.append(ForceFinding("dead axis", 0.0, seconds[-1], "xyz"[axis], float(known[0, axis]), 0, detail))
    bridged, longest = _gaps(seconds, bad, missing, findings)
    plausibility = ForcePlausibility(
        tuple(sorted(findings, key=lambda finding: finding.start_s)),
        dead_axes="".join("xyz"[axis] for axis in dead),
        bridged=bridged,
        longest_bridged_s=longest,
    )
    return plausibility.without(stamps_ns, bad)


def _rows(at: npt.NDArray[np.intp], like: BoolArray) -> BoolArray:
    rows = np.zeros_like(like)
    rows[at] = True
    return rows


def _dead(known: FloatArray, axes: list[int]) -> list[int]:
    """Returns the axes that never change while another one does."""
    constant = [axis for axis in axes if np.ptp(known[:, axis]) == 0.0]
    moving = any(len(np.unique(known[:, axis])) >= _MIN_DEAD_VALUES for axis in axes if axis not in constant)
    return constant if moving else []


def _spikes(values: FloatArray, noise: AxisNoise, share: float) -> tuple[BoolArray, float]:
    """Finds spikes of one or two rows, and outliers of any duration.

    Args:
        values: (n,) readings of one axis, N.
        noise: its noise.
        share: smallest height of a spike as a share of the range of the axis.

    Returns:
        Whether each reading (n,) is a spike or an outlier, and the largest height, N.
    """
    low, high = np.percentile(values, (0.5, 99.5))
    height = np.zeros(len(values))
    for width in (1, 2):
        before, after = values[: -width - 1], values[width + 1 :]
        inside = np.stack([values[1 + k : len(values) - width + k] for k in range(width)])  # (width, m) rows of a spike
        above_before, above_after = inside - before, inside - after
        same_side = (np.sign(above_before) == np.sign(above_after)).all(axis=0)
        spike_n = np.minimum(np.abs(above_before), np.abs(above_after)).min(axis=0)
        spike_n[~same_side | (np.abs(after - before) > MAX_RETURN_SHARE * spike_n)] = 0.0
        for k in range(width):  # every row of a spike gets its height
            spike_rows = height[1 + k : len(values) - width + k]
            np.maximum(spike_rows, spike_n, out=spike_rows)
    least = max(MIN_SPIKE_NOISES * noise.std_n, share * float(high - low))
    beyond = np.maximum(values - high, low - values)
    far = beyond > MIN_OUTLIER_RANGES * float(high - low) + MIN_SPIKE_NOISES * noise.std_n
    spikes = (height > least) | far
    if not spikes.any() or spikes.mean() > MAX_SPIKE_SHARE:
        return np.zeros(len(values), np.bool_), 0.0
    return spikes, float(np.where(far, beyond, height)[spikes].max())


def _clipped(
    values: FloatArray,
    noise: AxisNoise,
    others: dict[int, FloatArray],
    noises: dict[int, AxisNoise],
    spikes: BoolArray,
    range_n: float,
) -> tuple[BoolArray, float]:
    """Finds the readings on a plateau at an end of the range of an axis.

    Without a limit by the data sheet, a plateau is the highest (or lowest) band of readings, half a quantisation step
    or a quarter of the noise wide, with many readings in it and few just below it.

    Args:
        values: (n,) readings of the axis, N.
        noise: its noise.
        others: other axis -> its (n,) readings, N.
        noises: axis -> its noise.
        spikes: (n,) whether a reading is a spike; these do not count.
        range_n: largest reading by the data sheet, N; infinite where it is not known.

    Returns:
        Whether each reading (n,) is on a plateau, and its level, N; NaN without a plateau.
    """
    at_limit = np.abs(values) >= _LIMIT_SHARE * range_n
    if at_limit.any():
        at_upper_end = values[at_limit].mean() > 0.0
        return at_limit, range_n if at_upper_end else -range_n
    width = max(0.5 * noise.step_n, 0.25 * noise.std_n)
    clipped, level = np.zeros(len(values), np.bool_), math.nan
    for sign in (1.0, -1.0):  # the upper end, then the lower one
        signed = sign * values
        top = float(signed[~spikes].max())
        plateau = (signed > top - width) & ~spikes
        below = (signed <= top - width) & (signed > top - 3.0 * width)
        count = int(plateau.sum())
        if count < max(_MIN_CLIPPED, MIN_CLIPPED_RATIO * int(below.sum())):
            continue
        # visible noise makes every plateau suspicious; without it, the sensor may only be at rest
        if noise.longest_run or _others_move(plateau, others, noises):
            clipped |= plateau
            level = sign * top
    return clipped, level


def _others_move(plateau: BoolArray, others: dict[int, FloatArray], noises: dict[int, AxisNoise]) -> bool:
    """Returns whether the sensor is under a changing force on a plateau of an axis without visible noise.

    At rest a sensor with coarse steps repeats its value; then all axes are at rest. With a single axis, a plateau at
    the beginning of the log counts as rest.
    """
    if not others:
        return not plateau[0]
    for axis, values in others.items():
        span_n = float(np.ptp(np.percentile(values[plateau], (5, 95))))  # on the plateau, without its extremes
        noise, range_n = noises[axis], float(np.ptp(values))
        if span_n > max(MIN_MOVING_STEPS * noise.step_n, MIN_MOVING_NOISES * noise.std_n, MIN_MOVING_SHARE * range_n):
            return True
    return False


def _stuck(values: FloatArray, noise: AxisNoise) -> BoolArray:
    """Returns whether each reading (n,) is in a run of one value that is too long for the noise of the axis."""
    if not noise.longest_run:
        return np.zeros(len(values), np.bool_)
    _, lengths = run_lengths(values)
    return np.repeat(lengths > noise.longest_run, lengths)


def _gaps(seconds: FloatArray, bad: BoolArray, missing: BoolArray, findings: list[ForceFinding]) -> tuple[int, float]:
    """Finds the gaps between usable readings. Labels are interpolated across gaps of up to ``MAX_GAP_S``.

    Args:
        seconds: (n,) times of the readings, s.
        bad: (n,) whether a reading is not used.
        missing: (n,) whether a row has no reading.
        findings: gets the longer gaps.

    Returns:
        The number of gaps that labels bridge, and the longest of them, s.
    """
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    if usual > MAX_GAP_S or len(seconds) < 2:
        return 0, 0.0
    usable_rows = np.concatenate([[-1], np.flatnonzero(~bad), [len(bad)]])  # with the rows before and after the log
    times = np.concatenate([[seconds[0] - usual], seconds[~bad], [seconds[-1] + usual]])
    steps = np.diff(times)
    long = steps > MAX_GAP_S
    for gap in np.flatnonzero(long).tolist():
        rows = slice(int(usable_rows[gap]) + 1, int(usable_rows[gap + 1]))
        missing_count = int(missing[rows].sum())
        if missing_count < int(bad[rows].sum()):  # another finding gives the reason
            continue
        first, last = max(float(times[gap]), 0.0), min(float(times[gap + 1]), float(seconds[-1]))
        findings.append(ForceFinding("gap", first, last, readings=missing_count, detail="images in it get no force"))
    short = steps[(steps > MIN_GAP_STEPS * usual) & ~long]
    return len(short), float(short.max(initial=0.0))
