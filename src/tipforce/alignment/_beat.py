"""Inertia that repeats with the heart's beat, from the readings without contact alone.

Where no log states how the stage moves, the readings of the contact-free stretch are the inertia. It repeats with every
beat of the stage, so some harmonics of the beat describe it,

    F(t) = level + sum over k of a_k cos(2 pi k f t) + b_k sin(2 pi k f t),

and the same sum is subtracted from all readings. The frequency f comes from the whole log, so precisely that the sum
stays in step with the stage for minutes. Three checks decide whether it may be subtracted: the readings without contact
repeat, the beat is regular over the log, and the contact force is largest where the inertia is most negative: the stage
decelerates where it is furthest forward. The third one shows that the stage was not stopped in between.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..io import Inertia, Tare
from ..types import BoolArray, FloatArray, IntArray
from ._inertia import StageMotion, carried_n

MAX_INERTIA_N = 15e-3
"""Largest root mean square of an axis that may remain in the labels; a stage's log of 100 readings a second left up to
10.3 mN in simulated sessions."""
_MIN_INERTIA_N = 2e-3
"""Smaller inertia is not removed: the logs of a stage leave as much."""
_MAX_ERROR_N, _MAX_ERROR_SHARE = 8e-3, 0.5
"""Largest error by the beat's irregularity, root mean square (with 3 mN of noise 8.5 mN), and as a share of the
inertia."""
_MAX_TURN_DEG = 60.0
"""Largest angle between the contact's beat and the negative inertia's: 0 to 21 degrees in 40 simulated sessions."""
_BEAT_HZ = (0.4, 3.5)
_STEP_S = 0.02
"""Step of the grid on which the beat is searched in the whole log."""
_BLOCK_S, _MIN_BLOCKS = 4.0, 3
"""Length of a block whose phase is measured, and fewest blocks with a beat."""
_MIN_READINGS = 10
"""Fewest contact-free readings that are judged."""
MIN_BEAT_SHARE = 0.3
"""A block whose beat is weaker than this share of the median's does not count: no contact."""
MIN_BEATS = 2.0
"""Smallest number of beats in the contact-free stretch."""
_HARMONICS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of harmonics that are tried."""
_SUBHARMONICS = (1, 2, 3)
"""The strongest frequency may be a multiple of the beat's."""
_MAX_HZ, _READINGS_A_PERIOD = 30.0, 4.0
"""Highest harmonic: at most this frequency, with at least this number of readings in its period."""
_MAX_ROWS = 20_000
"""More readings than these are thinned for the fit."""
_SMOOTH_S = 0.04
"""Readings are averaged over this time before the inertia in them is measured, so that noise does not count."""

_Spectrum = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class _Pulse:
    """The beat of the log.

    Attributes:
        hz: frequency of its strongest harmonic.
        hz_stderr: one standard error of it.
        scatter_s: standard deviation of the times of the beat in single blocks.
        phasor: (k,) complex amplitude of this harmonic in each column of the readings.
    """

    hz: float
    hz_stderr: float
    scatter_s: float
    phasor: _Spectrum


def add_beat(
    stamps_ns: IntArray, force_n: FloatArray, stage: StageMotion, tare: Tare, inertia: Inertia
) -> tuple[Tare, Inertia]:
    """Adds to the inertia the part that repeats with the beat and that no log of the stage explains.

    Args:
        stamps_ns: (n,) of the readings.
        force_n: (n, 3) N; NaN where there is no plausible reading.
        stage: movement of the stage; empty without its log.
        tare: with its contact-free stretches.
        inertia: found from the stage's log.

    Returns:
        The same where less than 2 mN remain; with the reason in ``detail`` where the rest cannot be removed.
    """
    remainder = force_n - carried_n(stage, inertia, stamps_ns)
    axes = ~np.isnan(remainder).all(axis=0)
    rows = np.flatnonzero(np.isfinite(remainder[:, axes]).all(axis=1))
    free = tare.covers((stamps_ns[rows] - stamps_ns[0]) * 1e-9)  # readings without contact
    if (
        free.sum() < _MIN_READINGS
        or _rms(_smooth(stamps_ns[rows][free], remainder[rows][free][:, axes])) < _MIN_INERTIA_N
    ):
        return tare, inertia
    reference_ns = inertia.reference_ns if inertia.axes else int(stamps_ns[rows][free].mean())
    seconds: FloatArray = ((stamps_ns[rows] - reference_ns) * 1e-9).astype(np.float64)
    values = remainder[rows][:, axes]
    if inertia.axes:  # the stage's log shows the beat, the contact-free stretch included
        pulse = _pulse(seconds, stage.acceleration(inertia.stage_ns(stamps_ns[rows]), inertia.axes))
    else:
        pulse = _pulse(seconds[~free], values[~free])
    if isinstance(pulse, str):
        return tare, replace(inertia, detail=pulse)
    fit = _repeating(seconds[free], values[free], pulse.hz)
    if isinstance(fit, str):
        return tare, replace(inertia, detail=fit)
    level, hz, waves = fit
    size_n, problem = _checked(seconds, free, hz, waves, pulse, in_step=not inertia.axes)
    if problem:
        return tare, replace(inertia, detail=problem)
    if size_n < _MIN_INERTIA_N:
        return tare, inertia
    beat_n = np.zeros((len(waves), 2, 3))
    beat_n[:, :, axes] = waves
    level_n = tare.force_n.copy()
    level_n[axes] = level
    with_beat = replace(inertia, how="estimated", detail="", reference_ns=reference_ns, beat_hz=hz, beat_n=beat_n)
    return replace(tare, force_n=level_n), with_beat


def inertia_left(stamps_ns: IntArray, force_n: FloatArray, stage: StageMotion, tare: Tare, inertia: Inertia) -> float:
    """Returns the inertia that remains in the contact-free stretches after correction.

    Args:
        stamps_ns: (n,) stamps of the readings.
        force_n: (n, 3) readings in N; NaN where there is no plausible reading.
        stage: movement of the stage; empty without its log.
        tare: tare with its contact-free stretches.
        inertia: inertia that is subtracted.

    Returns:
        RMS in N of the axis with most of it; 0 if there are fewer than `_MIN_READINGS` readings.
    """
    remainder = force_n - carried_n(stage, inertia, stamps_ns)
    axes = ~np.isnan(remainder).all(axis=0)
    rows = np.flatnonzero(np.isfinite(remainder[:, axes]).all(axis=1))
    free = rows[tare.covers((stamps_ns[rows] - stamps_ns[0]) * 1e-9)]
    return _rms(_smooth(stamps_ns[free], remainder[free][:, axes])) if len(free) >= _MIN_READINGS else 0.0


def _smooth(stamps_ns: IntArray, values: FloatArray) -> FloatArray:
    """Returns means (bins, axes) over 40 ms."""
    _, bin_of, counts = np.unique(stamps_ns // round(_SMOOTH_S * 1e9), return_inverse=True, return_counts=True)
    return np.stack([np.bincount(bin_of, column) / counts for column in values.T], axis=1)


def _rms(values: FloatArray) -> float:
    return float(values.std(axis=0).max()) if len(values) else 0.0


def _pulse(seconds: FloatArray, values: FloatArray) -> _Pulse | str:
    """Finds the beat in ``values`` (n, k) at ``seconds`` (n,), or returns the reason why no beat can be followed.

    The peak of the spectrum gives a first frequency. If it is slightly wrong, the phase of the beat drifts from block
    to block: the slope of a straight line through these phases corrects it, three times.
    """
    bin_of = np.floor((seconds - seconds[0]) / _STEP_S).astype(np.int64) if len(seconds) else np.empty(0, np.int64)
    if not len(bin_of) or bin_of[-1] * _STEP_S < _MIN_BLOCKS * _BLOCK_S:
        return f"fewer than {_MIN_BLOCKS * _BLOCK_S:g} s of readings follow the beat"
    size = int(bin_of[-1]) + 1
    counts = np.bincount(bin_of, minlength=size)
    sums = np.stack([np.bincount(bin_of, column, size) for column in (values - values.mean(axis=0)).T], axis=1)
    even = sums / np.maximum(counts, 1)[:, None]  # (size, k) on an even grid; 0 where there is no reading
    time = seconds[0] + (np.arange(size) + 0.5) * _STEP_S
    padded = 8 * size  # a finer spectrum
    power = np.sum(np.abs(np.fft.rfft(even * np.hanning(size)[:, None], padded, axis=0)) ** 2, axis=1)
    hertz = np.fft.rfftfreq(padded, _STEP_S)
    band = np.flatnonzero((hertz >= _BEAT_HZ[0]) & (hertz <= _BEAT_HZ[1]))
    hz = float(hertz[band[np.argmax(power[band])]])
    block = np.minimum(np.arange(size) // round(_BLOCK_S / _STEP_S), size // round(_BLOCK_S / _STEP_S) - 1)
    block_time = np.bincount(block, time) / np.bincount(block)
    hz_stderr = scatter_s = math.inf
    total = np.zeros(even.shape[1], np.complex128)
    for _ in range(3):
        rotated = even * np.exp(-2j * math.pi * hz * time)[:, None]
        phasors = np.stack(
            [np.bincount(block, column.real) + 1j * np.bincount(block, column.imag) for column in rotated.T], axis=1
        )
        total = phasors.sum(axis=0)
        matched = phasors @ np.conj(total)  # (blocks,) how strong, and at which phase, each has the beat of all
        strong = np.abs(matched) > MIN_BEAT_SHARE * np.median(np.abs(matched))
        if strong.sum() < _MIN_BLOCKS:
            return "the beat is not seen in the whole log"
        phase = np.unwrap(np.angle(matched[strong]))
        from_middle = block_time[strong] - block_time[strong].mean()
        slope = float(from_middle @ phase) / float(from_middle @ from_middle)
        residual = phase - phase.mean() - slope * from_middle
        scatter = math.sqrt(float(residual @ residual) / max(len(residual) - 2, 1))
        hz += slope / (2.0 * math.pi)
        hz_stderr = scatter / math.sqrt(float(from_middle @ from_middle)) / (2.0 * math.pi)
        scatter_s = scatter / (2.0 * math.pi * hz)
    return _Pulse(hz, hz_stderr, scatter_s, 2.0 * total / max(int((counts > 0).sum()), 1))


def _columns(seconds: FloatArray, hz: float, count: int) -> FloatArray:
    """Returns cosines, then sines, (n, 2 count)."""
    turns = 2.0 * math.pi * hz * np.outer(seconds, np.arange(1, count + 1))
    return np.hstack([np.cos(turns), np.sin(turns)])


def _repeating(seconds: FloatArray, values: FloatArray, hz: float) -> tuple[FloatArray, float, FloatArray] | str:
    """Fits level and harmonics of the beat to contact-free readings, or returns the reason why it cannot.

    The beat is at ``hz`` or a half or third of it, with the number of harmonics that the Bayesian information criterion
    prefers.

    Args:
        seconds: (n,) times.
        values: (n, k) readings, N.
        hz: strongest frequency.

    Returns:
        Level (k,) in N, frequency of the beat, and cosines and sines of its harmonics (count, 2, k) in N.
    """
    step = -(-len(seconds) // _MAX_ROWS)  # rounded up
    seconds, values = seconds[::step], values[::step]
    span, rate = float(np.ptp(seconds)), len(seconds) / max(float(np.ptp(seconds)), 1e-9)
    if span * hz < MIN_BEATS:
        return f"the contact-free stretch of {span:.1f} s holds fewer than {MIN_BEATS:g} beats"
    highest = min(_MAX_HZ, rate / _READINGS_A_PERIOD)
    best, least = None, math.inf
    for divisor in _SUBHARMONICS:
        beat_hz = hz / divisor
        counts = [count for count in _HARMONICS if count >= divisor and beat_hz * count <= highest]
        if span * beat_hz < MIN_BEATS or not counts:
            continue
        columns = np.column_stack([np.ones(len(seconds)), _columns(seconds, beat_hz, counts[-1])])
        squares, products = columns.T @ columns, columns.T @ values
        for count in counts:  # level, the first cosines and the first sines
            used = np.concatenate([[0], np.arange(1, count + 1), counts[-1] + np.arange(1, count + 1)])
            solved = np.linalg.solve(squares[np.ix_(used, used)], products[used])
            loss = float(np.sum((values - columns[:, used] @ solved) ** 2))
            criterion = values.size * math.log(max(loss, 1e-30)) + solved.size * math.log(len(seconds))
            if criterion < least:
                waves = np.stack([solved[1 : 1 + count], solved[1 + count :]], axis=1)
                best, least = (solved[0].astype(np.float64), beat_hz, waves.astype(np.float64)), criterion
    return best or f"the force log's {rate:.0f} readings a second are too few"


def _checked(
    seconds: FloatArray, free: BoolArray, hz: float, waves: FloatArray, pulse: _Pulse, *, in_step: bool
) -> tuple[float, str]:
    """Returns the RMS inertia on its strongest axis in N, and the reason why it may not be subtracted, or "".

    ``free`` (n,) states for each of ``seconds`` (n,) whether there is no contact. ``waves`` (count, 2, k) are in N.
    ``in_step``: whether the beat of the contact is compared with that of the inertia.
    """
    squares = np.sum(waves**2, axis=1)  # (count, k)
    size_n = math.sqrt(0.5 * float(squares.sum(axis=0).max()))
    angular = 2.0 * math.pi * hz * np.arange(1, len(waves) + 1)  # rad/s
    slope_n_per_s = math.sqrt(0.5 * float((angular[:, None] ** 2 * squares).sum(axis=0).max()))
    farthest_s = float(np.abs(seconds - seconds[free].mean()).max())
    timing_s = math.hypot(pulse.scatter_s, pulse.hz_stderr / pulse.hz * farthest_s)
    error_n = slope_n_per_s * timing_s
    if error_n > min(_MAX_ERROR_N, _MAX_ERROR_SHARE * size_n):
        return size_n, f"the beat is irregular by {1e3 * timing_s:.0f} ms"
    if in_step:
        number = round(pulse.hz / hz) - 1  # the harmonic that is strongest in the whole log
        inertia = waves[number, 0] - 1j * waves[number, 1]
        contact = pulse.phasor - inertia
        turn_deg = math.degrees(abs(float(np.angle(-np.sum(contact * np.conj(inertia))))))
        if turn_deg > _MAX_TURN_DEG:
            return size_n, (
                f"the contact's beat is {turn_deg:.0f} degrees off that of a moving mass: the tip touches in the "
                "contact-free stretch, or the stage was stopped after it"
            )
    return size_n, ""
