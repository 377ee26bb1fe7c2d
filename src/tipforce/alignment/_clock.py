"""The map between the camera's clock and the force log's, offset and rate, from the catheter's own deflection.

An elastic shaft takes its shape without delay: shape and force belong to the same instant, with friction and contact or
not. The bending moment at s is the lever from s to the tip times the force, and both lever and bend are in the image.
So

    B = c0(t) + c1 G + c2 G^2 + c3 G^3,    B = integral w(s) dtheta,    G(t) = integral w(s) [lever(s) x F(t)]_z ds,

with theta the shaft's angle, w a bell over the part that bends, c's that hold the unknown stiffness, and a c0 that
follows the shaft's slow drift. Trial maps come from `search_clock`; the most likely one leaves the smallest residual.
A free regression on both components of the force is worse by milliseconds: friction follows the wall's velocity, so
its coefficient can replace a shift in time. Physics binds the two components, up to an error of the sensor's angle
that is fitted with a prior of two degrees.

The motion of the wall cannot be used instead: it leads the force by the tissue's loss angle.

Three checks make the result trustworthy: rivals (another beat, another rate) must leave clearly more of the bend
unexplained; each stretch of the session on its own must agree with the line; the standard errors hold the scatter
between blocks of a second and between stretches, and the change by another elastic law, contact point or low-pass.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from ..io import ClockMap
from ..types import BoolArray, FloatArray, IntArray
from ._clock_fit import ANY_ANGLE, SMOOTH_S, STATED_ANGLE, Data, Fit, Force, Tilted, beat_hz
from ._clock_search import Coarse, search_clock

_BLOCK_S = 1.0
"""Length of the stretches between which the scatter is measured."""
_MAX_BLOCKS, _TRIED_BLOCKS = 150, 90
"""Blocks of a long session that are used, evenly spread; and those that trial maps are compared on."""
_REPLICATES = 100
"""Draws of the bootstrap over blocks."""
_CANDIDATES = 6
"""Trial maps of each kind that the coarse search gives."""
_SEARCHED_S = 90.0
"""Images of at most this length are searched for trial maps; the map found is followed over the others."""
_WIDE_S, _WIDE_STEP_S, _WIDE_TILT_S = 0.3, 12e-3, 0.08
"""How far a trial map may be off, in its middle and at its ends: friction makes the free regression late or early."""
_FINE_S, _FINE_STEP_S, _FINE_TILT_S = 40e-3, 2e-3, 20e-3
"""The same of a map that was refined once."""
_NEAR_BEST = 4.0
"""Trial maps that leave more than this multiple of the best one's unexplained bend are dropped."""
_MIN_FRAMES, _MIN_SPAN_S, _MIN_PLAUSIBLE = 50, 3.0, 0.3
MIN_EXPLAINED, _MIN_EXPLAINED_INERTIAL = 0.5, 0.8
"""Share of the bend that the force must explain; the second where the readings hold an unknown inertia: such a fit with
45 % was off by 230 ms, those with 96 % and more were right (8 simulated sessions)."""
MAX_STDERR_MS = 5.0
"""Largest standard error of the time of a label, root mean square over the session: 10 mN at 2 N/s."""
_RIVAL_Z = 3.0
_RIVAL_RATIO = 1.5
"""A rival is excluded where it leaves more of the bend unexplained: by this number of standard errors of the difference
between blocks, or by this ratio: a single onset of contact counts in one block only."""
_RIVAL_BLOCK_S = 2.0
_RIVAL_APART_S = 0.06
"""Maps that differ by less at both ends of the images are one."""
_MIN_COMMON_SHARE, _MAX_LOSS = 0.5, 40.0
"""Two maps are compared image by image if they share this part of the images. Larger squared residuals of the best map
than this multiple of their median count as that: another object was detected."""
_MAX_RESIDUAL = 6.0
"""Images with a larger residual than this multiple of the usual one are left out of the final fit."""
_TRIAL_STDERR_MS = 12.0
"""Standard error of a trial map that fits clearly better than the stage's: three of it and of the stage's are less than
the distance of rivals, so that the two maps differ."""
_ALIKE_STDERR_MS = 1e3 * _RIVAL_APART_S
"""Standard error of the stage's map where others fit alike."""
_OTHER_DEGREES = (2, 5)
"""Degrees of the elastic law that are tried too: their results show how much the estimate depends on the degree."""
_FLOOR_MS = 0.7
"""Floor of the standard error: cross-checks do not show errors of detection (hundredths of a pixel) and of the tare."""
_MAX_TURN_DEG, _FREE_GAIN = 10.0, 0.7
"""The stated angle counts as wrong where another, further off than this, leaves less than this share unexplained."""
_STRETCHES = 8
_MAX_JUMP_S, _JUMP_Z = 25e-3, 5.0
"""A stretch that is off the line by more than both is a jump of a clock, or images that are missing."""
_MIN_ENERGY = 4.0
"""Smallest ratio of the energy of a stretch's fitted bend to the usual residual: without contact it does not count."""
_MIN_ENERGY_SHARE = 0.1
"""Smallest share of the median energy of the stretches."""
_NEIGHBOURS, _OUTLYING, _OUTLYING_SHARE = 5, 10.0, 0.35
"""An image is left out where its bend differs from the median of this number of neighbours by more than this multiple
of the usual difference, and by more than this share of the range of the bend."""
_SAME_RATE_Z = 2.5
"""Two clocks whose rates differ by no more standard errors run at one rate."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """Force time = camera time / rate - lag, each since its stream's first stamp, s."""

    rate: float
    lag_s: float

    def force_s(self, camera_s: FloatArray) -> FloatArray:
        return camera_s / self.rate - self.lag_s

    def moved(self, tilted: Tilted, span: tuple[float, float]) -> "_Trial":
        """Returns the map after a shift and tilt in s; ``span``: middle and half length of the images, see `Fit`."""
        shift, tilt = tilted
        middle, half = span
        slower = 1.0 - tilt / half
        return _Trial(self.rate / slower, self.lag_s * slower + shift - tilt * middle / half)

    def apart_s(self, other: "_Trial", camera_s: FloatArray) -> float:
        """Returns the largest difference at the first and the last of ``camera_s``."""
        ends = camera_s[[0, -1]]
        return float(np.abs(self.force_s(ends) - other.force_s(ends)).max())


@dataclass(frozen=True, slots=True, eq=False)
class _Session:
    """The data of the fit.

    Attributes:
        time_s: (n,) times of the usable images since the first one.
        coordinates: (n, 4) `shape_coordinates` of these.
        force_s: (m,) times of the readings since the first one.
        force_n: (m, 2) forces x and y, base frame, N.
        force: the same on an even grid, low-passed.
        beat_hz: beat of an inertia that is still in the force; 0 without one.
        fixed_rate: stated rate of the camera's clock, or None.
        removed_hz: beat of an inertia that was removed from the force; 0 without one.
    """

    time_s: FloatArray
    coordinates: FloatArray
    force_s: FloatArray
    force_n: FloatArray
    force: Force
    beat_hz: float
    fixed_rate: float | None
    removed_hz: float = 0.0

    @property
    def min_explained(self) -> float:
        """Share of the bend that the force must explain."""
        return _MIN_EXPLAINED_INERTIAL if self.beat_hz else MIN_EXPLAINED

    def data(
        self, trial: _Trial, frames: BoolArray, margin_s: float, max_blocks: int = _MAX_BLOCKS
    ) -> tuple[Data, BoolArray]:
        """Returns the data of the images that have a force by a trial map, and which images (n,) these are.

        Args:
            trial: the map.
            frames: (n,) whether an image may be used.
            margin_s: time around an image in which there must be readings.
            max_blocks: largest number of blocks; of more, every second, third, ... one is used.
        """
        seconds = trial.force_s(self.time_s)
        used = frames & self.force.known(seconds, margin_s)
        blocks = np.floor(seconds / _BLOCK_S).astype(np.int64)
        stride = max(1, -(-len(np.unique(blocks[used])) // max_blocks))  # rounded up
        used &= blocks % stride == 0
        return Data(seconds[used], self.coordinates[used], blocks[used], self.force, self.beat_hz), used


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A trial map after its refinement.

    Attributes:
        trial: the map.
        loss: (n,) squared residual of the bend of each image, rad^2; NaN for images without a force by it.
        share: share of the bend that it leaves unexplained.
    """

    trial: _Trial
    loss: FloatArray
    share: float


def estimate_clock(
    frame_ns: IntArray,
    coordinates: FloatArray,
    force_ns: IntArray,
    force_n: FloatArray,
    *,
    rate: float | None = None,
    inertial: bool = False,
    removed: bool = False,
    shared_ns: int | None = None,
) -> ClockMap:
    """Finds the offset and rate at which force and deflection belong together.

    Args:
        frame_ns: (n,) stamps of the images.
        coordinates: (n, 4) of `shape_coordinates`; rows with NaN are left out.
        force_ns: (m,) stamps of the readings.
        force_n: (m, 2 or more) N, x and y in the base frame as far as it is known, tared; NaN where a reading is not
            plausible: images that need it are left out.
        rate: of the camera's clock against the log's, where a person states it.
        inertial: whether the readings hold the inertia of a mass whose movement no log states.
        removed: whether inertia was removed from them: the standard errors then include the effect of a part that was
            left, because a stage lags behind the commands in its log.
        shared_ns: the offset if the camera shares the clock of the stage. Maps that fit alike are decided by it, but
            only in favour of the one that fits best.

    Returns:
        ``how="refused"`` with the reason where the map cannot be determined. Its offset and rate, where they are not 0
        and 1, are only the best of the trial maps; it has a standard error where it is known how well the stage's map
        fits beside it. Without one, and with `MIN_EXPLAINED` or more explained, no line through the session fits.
    """
    detected = np.flatnonzero(np.isfinite(coordinates).all(axis=1))
    usable = np.zeros(len(coordinates), np.bool_)
    usable[detected[~_outlying(coordinates[detected, 0])]] = True
    seconds = (frame_ns - frame_ns[0]) * 1e-9 if len(frame_ns) else np.empty(0)
    if usable.sum() < _MIN_FRAMES or np.ptp(seconds[usable]) < _MIN_SPAN_S:
        return _refused(f"only {int(usable.sum())} images show the catheter; {_MIN_SPAN_S:g} s are needed")
    plausible = np.isfinite(force_n[:, :2]).all(axis=1)
    if plausible.mean() < _MIN_PLAUSIBLE or np.ptp(force_ns[plausible]) < _MIN_SPAN_S * 1e9:
        return _refused(f"only {int(plausible.sum())} of {len(force_ns)} readings of the force are plausible")
    force_s = (force_ns - force_ns[0]) * 1e-9
    force = Force(force_s, force_n[:, :2])
    session = _Session(
        seconds[usable], coordinates[usable], force_s, force_n[:, :2], force,
        beat_hz=beat_hz(force) if inertial else 0.0, fixed_rate=rate, removed_hz=beat_hz(force) if removed else 0.0,
    )  # fmt: skip
    searched = _searched(session)
    apart_ns = int(force_ns[0] - frame_ns[0])  # between the zeros of the two times in the session
    nominal = _Trial(rate or 1.0, 1e-9 * float(apart_ns) / (rate or 1.0))
    ranked = _best_maps(session, nominal, searched)
    if not ranked:
        return _refused(
            f"no offset brings images and force of {_MIN_SPAN_S:g} s together; {_MIN_SPAN_S:g} s are needed"
        )
    best = ranked[0]
    shared = None if shared_ns is None else _Trial(1.0, 1e-9 * float(apart_ns + shared_ns))
    differs_from_stage = shared is None or best.trial.apart_s(shared, session.time_s) > _RIVAL_APART_S
    stage_fits_worse = False
    if shared is not None and differs_from_stage:
        stage = _refined(session, shared, searched, wide=False)
        stage_fits_worse = stage is None or not _rivals(best, stage, session)

    def tried(refused: ClockMap, trial: _Trial, stderr_ms: float) -> ClockMap:
        """Returns the refusal with the offset and rate of a trial map."""
        offset_ns = round(1e9 * trial.rate * trial.lag_s) - apart_ns
        return replace(
            refused, offset_ns=offset_ns, rate=trial.rate, stderr_ms=stderr_ms, reference_ns=int(force_ns[0])
        )

    if 1.0 - best.share < session.min_explained:
        # a stage on the camera's clock may yet be taken out of the force at this rate
        stderr_ms = _TRIAL_STDERR_MS if stage_fits_worse else math.nan
        return tried(_unexplained(1.0 - best.share, session), best.trial, stderr_ms)
    alike = _alike(ranked, session) if differs_from_stage else []
    if len(alike) > 1:
        listed = " and ".join(_named(each.trial, apart_ns) for each in alike[:4])
        refused = _refused(f"{listed} fit alike: the motion repeats itself or is too little", 1.0 - best.share)
        if stage_fits_worse:
            return tried(refused, best.trial, _TRIAL_STDERR_MS)
        return refused if shared is None else tried(refused, shared, _ALIKE_STDERR_MS)
    measured = _measured(session, best.trial, frame_ns, force_ns)
    if measured.how == "refused" and math.isnan(measured.stderr_ms) and stage_fits_worse:
        return tried(measured, best.trial, _TRIAL_STDERR_MS)
    return measured


def _best_maps(session: _Session, nominal: _Trial, searched: BoolArray) -> list[_Candidate]:
    """Returns the nominal map and those of the coarse search, refined twice on the ``searched`` images, best first."""
    trials = [nominal, *(_Trial(each.rate, each.lag_s) for each in _coarse(session, searched))]
    wide = _ranked([_refined(session, trial, searched, wide=True) for trial in trials])
    near_best = [each for each in wide if each.share < _NEAR_BEST * wide[0].share]
    return _ranked([_refined(session, each.trial, searched, wide=False) for each in near_best])


def _alike(ranked: list[_Candidate], session: _Session) -> list[_Candidate]:
    """Returns the best map, and those that fit about as well but differ from it and from one another."""
    alike = ranked[:1]
    for candidate in ranked[1:]:
        apart = all(candidate.trial.apart_s(each.trial, session.time_s) > _RIVAL_APART_S for each in alike)
        if apart and _rivals(ranked[0], candidate, session):
            alike.append(candidate)
    return alike


def _outlying(bend: FloatArray) -> BoolArray:
    """Returns whether the bend of each image (n,) is far from that of its neighbours: another object was detected."""
    if len(bend) < _MIN_FRAMES:
        return np.zeros(len(bend), np.bool_)
    difference = np.abs(bend - median_filter(bend, _NEIGHBOURS))
    low, high = np.percentile(bend, (5.0, 95.0))
    limit: float = max(_OUTLYING * float(np.median(difference)), _OUTLYING_SHARE * float(high - low))
    return difference > limit


def _searched(session: _Session) -> BoolArray:
    """Returns whether each image (n,) is searched: those of the 90 s in which the catheter moves most."""
    time = session.time_s
    if np.ptp(time) <= _SEARCHED_S:
        return np.ones(len(time), np.bool_)
    movement = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(session.coordinates[:, 0])))])
    last = np.searchsorted(time, time + _SEARCHED_S) - 1
    fits_in = time + _SEARCHED_S <= time[-1]
    start = int(np.argmax(np.where(fits_in, movement[last] - movement, -1.0)))
    return (time >= time[start]) & (time <= time[start] + _SEARCHED_S)


def _coarse(session: _Session, frames: BoolArray) -> list[Coarse]:
    """Returns the trial maps of the coarse search over ``frames`` (n,); the median levers serve for all images."""
    levers = np.median(session.coordinates[frames, 1:3], axis=0)
    time_s, bend = session.time_s[frames], session.coordinates[frames, 0]
    return search_clock(time_s, bend, session.force_s, session.force_n, levers, _CANDIDATES, session.fixed_rate)


def _ranked(candidates: list[_Candidate | None]) -> list[_Candidate]:
    return sorted((each for each in candidates if each is not None), key=lambda each: each.share)


def _refined(session: _Session, trial: _Trial, frames: BoolArray, *, wide: bool) -> _Candidate | None:
    """Finds the best map near ``trial`` on ``frames`` (n,); None where too few of them have a force by it.

    ``wide``: a map of the coarse search; else one that was refined already.
    """
    reach, step, tilt = (_WIDE_S, _WIDE_STEP_S, _WIDE_TILT_S) if wide else (_FINE_S, 2.0 * _FINE_STEP_S, _FINE_TILT_S)
    tilt = 0.0 if session.fixed_rate else tilt
    data, used = session.data(trial, frames, reach + tilt + 3.0 * SMOOTH_S, _TRIED_BLOCKS)
    if used.sum() < _MIN_FRAMES or np.ptp(data.time) < _MIN_SPAN_S:
        return None
    fit, tilted, _ = _with_angle(Fit(data.touching(), _ticks(reach + tilt, step)), tilt)
    loss = np.full(len(frames), math.nan)
    loss[used] = fit.residuals(tilted) ** 2
    bend_square = max(float(np.mean(fit.bend**2)), 1e-30)
    # an image without a force is one of which nothing is explained
    share = min(1.0, used.sum() * _stride(data) / frames.sum())
    unexplained = 1.0 - share * (1.0 - float(np.nanmean(loss)) / bend_square)
    return _Candidate(trial.moved(tilted, fit.span), loss, unexplained)


def _with_angle(fit: Fit, tilt_s: float) -> tuple[Fit, Tilted, float]:
    """Decides whether the stated angle of the sensor holds, and finds the best map.

    Args:
        fit: the fit.
        tilt_s: largest tilt that is tried.

    Returns:
        The fit with a prior of two degrees on the angle, its best shift and tilt, and 0. Where the stated angle is
        clearly wrong: the fit with the angle open, its best shift and tilt, and the turn of the sensor in degrees.
    """
    fit = fit.with_penalty(STATED_ANGLE)
    fit = fit.with_penalty(fit.penalty_at(fit.best(tilt_s)))
    free, tilted = fit.with_penalty(ANY_ANGLE), fit.best(tilt_s)
    free_tilted = free.best(tilt_s)
    turn_deg = math.degrees(free.angle(free_tilted))
    gain = free.residuals(free_tilted).var() < _FREE_GAIN * fit.residuals(tilted).var()
    if abs(turn_deg) > _MAX_TURN_DEG and gain:
        return free, free_tilted, turn_deg
    return fit, tilted, 0.0


def _stride(data: Data) -> int:
    blocks = np.unique(data.blocks)
    return max(1, int(np.min(np.diff(blocks)))) if len(blocks) > 1 else 1


def _ticks(reach: float, step: float) -> FloatArray:
    count = round(reach / step)
    return np.arange(-count, count + 1, dtype=np.float64) * step


def _rivals(best: _Candidate, other: _Candidate, session: _Session) -> bool:
    """Returns whether ``other`` explains about as much of the bend as ``best`` in blocks of 2 s; see `_RIVAL_RATIO`."""
    both = np.isfinite(best.loss) & np.isfinite(other.loss)
    if both.sum() < _MIN_COMMON_SHARE * np.isfinite(best.loss).sum():
        return other.share < _RIVAL_RATIO * best.share
    usual = float(np.nanmedian(best.loss))
    best_loss, other_loss = np.minimum(best.loss[both], _MAX_LOSS * usual), other.loss[both]
    block = np.floor(session.time_s[both] / (_RIVAL_BLOCK_S * best.trial.rate)).astype(np.int64)
    block_of = np.unique(block, return_inverse=True)[1]
    gain = np.bincount(block_of, other_loss - best_loss)  # of the best map, by block
    z = float(gain.mean() / max(float(gain.std(ddof=1)) / math.sqrt(len(gain)), 1e-30)) if len(gain) > 2 else 0.0
    return z < _RIVAL_Z and float(other_loss.sum()) < _RIVAL_RATIO * float(best_loss.sum())


def _measured(session: _Session, trial: _Trial, frame_ns: IntArray, force_ns: IntArray) -> ClockMap:
    """Fits the map near ``trial`` with its standard errors to all images; refused where a check fails.

    The map is followed over ever longer stretches. Images in which another object was detected are then left out. A
    rate that does not differ from 1 by its standard error is taken as 1, and the fit repeated. ``frame_ns`` (n,) and
    ``force_ns`` (m,) are the stamps of all images and readings.
    """
    all_frames = np.ones(len(session.time_s), np.bool_)
    margin = _FINE_S + _WIDE_TILT_S + 3.0 * SMOOTH_S
    tilt = 0.0 if session.fixed_rate else _FINE_TILT_S
    for frames in (*_growing(session), all_frames):
        data, _ = session.data(trial, frames, margin)
        fit, tilted, _ = _with_angle(Fit(data.touching(), _ticks(2.0 * _FINE_S, 2.0 * _FINE_STEP_S)), 2.0 * tilt)
        trial = trial.moved(tilted, fit.span)
    data, _ = session.data(trial, all_frames, margin)
    data = data.touching()
    free = Fit(data, _ticks(_FINE_S, _FINE_STEP_S), ANY_ANGLE)
    tilted = free.best(tilt)
    for _ in range(3):  # leaves out images in which another object was detected
        residuals = np.abs(free.residuals(tilted))
        # the usual size comes from frames in contact: without it nothing is left to explain, and all seems outlying
        usual = float(np.median(residuals[data.loaded()]))
        keep = residuals <= _MAX_RESIDUAL * max(usual, 1e-12)
        if keep.all():
            break
        data = data.subset(keep)
        free = Fit(data, free.shifts, ANY_ANGLE)
        tilted = free.best(tilt)
    fit, tilted, turn_deg = _with_angle(free, tilt)
    penalty, note = fit.penalty, ""
    if turn_deg:
        note = (
            f"force and deflection agree only if the sensor is turned by {turn_deg:.0f} deg more than stated, or the "
            "images are mirrored or turned: check sensor.angle_deg, sensor.reads, and that the images show the bench "
            "as it is"
        )
    elif fit.slope(tilted) < 0:
        note = (
            "the deflection goes against the force: check the sensor's angle, whether it reads tip-on-tissue, and that "
            "the images are not mirrored"
        )
    explained = fit.explained(tilted)
    if explained < session.min_explained:
        return _unexplained(explained, session)
    pivot, errors_s = _errors(session, data, fit, penalty, tilted, tilt)
    middle, half = fit.span
    scatter_s = _scatter(fit, data, penalty, tilted, pivot, errors_s)
    if isinstance(scatter_s, str):
        return _refused(scatter_s, explained)
    errors_s = np.maximum(errors_s, scatter_s)
    final, at_s = trial.moved(tilted, fit.span), middle + pivot * half
    rate_effect_s = abs(final.rate - 1.0) * half  # difference to a rate of 1 at both ends
    if not session.fixed_rate and rate_effect_s < _SAME_RATE_Z * errors_s[1]:
        same_rate = _Trial(1.0, final.rate * (at_s + final.lag_s) - at_s)
        clock = _measured(replace(session, fixed_rate=1.0), same_rate, frame_ns, force_ns)
        # the rate may differ from 1 by this, though 1 is taken for it
        return _certain(replace(clock, rate_stderr=_digits(math.hypot(errors_s[1], rate_effect_s) / half)), half)
    reference_ns = int(force_ns[0]) + round(at_s * 1e9)
    camera_ns = int(frame_ns[0]) + round(final.rate * (at_s + final.lag_s) * 1e9)
    result = ClockMap(
        offset_ns=_microsecond(camera_ns - reference_ns),
        how="estimated",
        stderr_ms=round(1e3 * float(errors_s[0]), 3),
        explained=round(explained, 6),
        detail=note,
        rate=session.fixed_rate or round(final.rate, 7),
        rate_stderr=0.0 if session.fixed_rate else _digits(final.rate * float(errors_s[1]) / half),
        reference_ns=reference_ns,
    )
    return _certain(result, half)


def _digits(rate_stderr: float) -> float:
    return round(rate_stderr, 8)


def _certain(found: ClockMap, half_s: float) -> ClockMap:
    """Returns ``found``, refused where labels are uncertain in time: by RMS over ``half_s`` to both sides."""
    label_ms = math.hypot(found.stderr_ms, 1e3 * found.rate_stderr / found.rate * half_s / math.sqrt(3.0))
    if found.how == "refused" or label_ms <= MAX_STDERR_MS:
        return found
    detail = f"{_text(found)} fits best, but only to +-{label_ms:.0f} ms (standard error): too little motion"
    return replace(found, how="refused", stderr_ms=round(label_ms, 3), detail=detail)


def _growing(session: _Session) -> list[BoolArray]:
    """Returns ever longer stretches about the one that was searched; the map is followed over a long session."""
    searched = _searched(session)
    if searched.all():
        return []
    first, last = session.time_s[searched][[0, -1]]
    stretches: list[BoolArray] = []
    length = 3.0 * (last - first)
    while length < 2.0 * np.ptp(session.time_s):
        stretches.append((session.time_s > first - length / 2) & (session.time_s < last + length / 2))
        length *= 3.0
    return stretches


def _errors(
    session: _Session, data: Data, fit: Fit, penalty: float, found: Tilted, tilt: float
) -> tuple[float, FloatArray]:
    """Returns x of `Tilted` where the shift is known best, and the standard errors (2,) of shift and tilt there, s.

    They follow from the scatter between blocks (bootstrap) and from half the range of the results of other laws:
    another degree, another contact point, a sharper low-pass, a rest of removed inertia. ``found`` is the best shift
    and tilt of ``fit``; ``tilt`` is the largest tilt that is tried, s, and 0 where the rate is stated.
    """
    even = np.full(fit.count, 1.0 / fit.count)
    weights = np.random.default_rng(0).multinomial(fit.count, even, _REPLICATES).astype(np.float64)
    peaks = fit.peaks(weights, found, 2.0 * _FINE_STEP_S, 2.0 * _FINE_STEP_S if tilt else 0.0)
    other_laws = [Fit(data, fit.shifts, penalty, degree) for degree in _OTHER_DEGREES]
    other_laws.append(Fit(data.touching(-1.0), fit.shifts, penalty))
    sharper = replace(data, force=Force(session.force_s, session.force_n, 0.5 * SMOOTH_S))
    other_laws.append(Fit(sharper, fit.shifts, penalty))
    if session.removed_hz:
        other_laws.append(Fit(replace(data, beat_hz=session.removed_hz), fit.shifts, penalty))
    laws = np.array([found, *(law.best(tilt) for law in other_laws)])
    pivot = 0.0  # there the errors of shift and tilt are not correlated
    if tilt:
        covariance = np.cov(peaks.T)
        pivot = float(np.clip(-covariance[0, 1] / max(covariance[1, 1], 1e-30), -0.6, 0.6))
    for values in (peaks, laws):
        values[:, 0] += pivot * values[:, 1]
    floor = 1e-3 * _FLOOR_MS * np.array([1.0, 1.0 if tilt else 0.0])
    return pivot, np.sqrt(peaks.std(axis=0) ** 2 + (0.5 * np.ptp(laws, axis=0)) ** 2 + floor**2)


def _scatter(
    fit: Fit, data: Data, penalty: float, found: Tilted, pivot: float, errors_s: FloatArray
) -> FloatArray | str:
    """Compares the shift of each eighth of the session with the straight line through all.

    Returns standard errors (2,) of shift and tilt in s by the scatter about the line, or the fault as text where a
    stretch is far off it. ``errors_s`` (2,) are those of `_errors` at its ``pivot``; 0 for a tilt that is stated.
    """
    wide = Fit(data, _ticks(_WIDE_S, 0.5 * _WIDE_STEP_S), penalty)
    groups = np.minimum((0.5 * (wide.place + 1.0) * _STRETCHES).astype(np.int64), _STRETCHES - 1)
    groups = np.unique(groups, return_inverse=True)[1]
    local = wide.local_shifts(found, groups)
    place = np.array([wide.place[groups == number].mean() for number in range(len(local))]) - pivot
    moving = local[:, 2] > max(_MIN_ENERGY, _MIN_ENERGY_SHARE * float(np.median(local[:, 2])))
    place, shift_s, stderr_s = place[moving], local[moving, 0], local[moving, 1]
    weight = 1.0 / np.maximum(stderr_s, 1e-3 * _FLOOR_MS) ** 2
    limit_s = np.maximum(_MAX_JUMP_S, _JUMP_Z * np.hypot(stderr_s, errors_s[0]))
    off = (stderr_s < _MAX_JUMP_S) & (np.abs(shift_s) > limit_s)
    if off.any():
        number = int(np.flatnonzero(off)[0])
        middle, half = fit.span
        at_s = middle + half * (place[number] + pivot)
        return (
            f"at {at_s:.0f} s of the force log the deflection is {1e3 * shift_s[number]:+.0f} ms off the line through "
            "all stretches: a clock jumps, or images or readings are missing without a gap in their stamps"
        )
    count = 2 if errors_s[1] else 1  # shift and tilt, or shift only
    columns = np.stack([np.ones_like(place), place], axis=1)[:, :count]
    if len(shift_s) <= count:
        return np.zeros(2)
    square = (columns.T * weight) @ columns
    residuals = shift_s - columns @ np.linalg.solve(square, columns.T @ (weight * shift_s))
    variance = np.diag(np.linalg.inv(square)) * float(weight @ residuals**2) / (len(shift_s) - count)
    return np.append(np.sqrt(variance), 0.0)[:2]


def _microsecond(nanoseconds: int) -> int:
    """Rounds to the microsecond: nothing finer is known."""
    return 1000 * round(nanoseconds / 1000)


def _named(trial: _Trial, apart_ns: int) -> str:
    """Returns the map as a person states it: its offset at the log's first row, and its rate."""
    offset_ms = 1e3 * trial.rate * trial.lag_s - 1e-6 * float(apart_ns)
    return f"{offset_ms:+.0f} ms at a rate of {trial.rate:.6g}"


def _text(clock: ClockMap) -> str:
    return f"{clock.offset_ms:+.0f} ms at a rate of {clock.rate:.6g}"


def _unexplained(explained: float, session: _Session) -> ClockMap:
    return _refused(
        f"the force explains {100.0 * max(explained, 0.0):.0f} % of the deflection at best "
        f"({100.0 * session.min_explained:.0f} % are needed): too little contact or motion, or a clock that jumps",
        explained,
    )


def _refused(reason: str, explained: float = math.nan) -> ClockMap:
    return ClockMap(0, "refused", explained=round(explained, 6), detail=reason)
