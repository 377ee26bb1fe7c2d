"""Calibrates a bench from recordings: fits each session alone, then combines the results."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .._system.rows import evenly_spread
from ..errors import InputError
from ..estimators.session import PriorSettings, RodSettings
from ..types import FloatArray, IntArray, SessionInfo
from ._knob import KnobFit, fit_knob
from ._quantity import Quantity, combined
from ._rest_shape import RestShape, fit_rest_shape, rest_quantity
from ._rod_fit import MIN_DRIFT_PER_M, RodFit, fit_rod, line_forces
from ._session import CalibrationSession
from ._tissue import TissueFit, fit_tissue

_ROD_FRAMES, _KNOB_FRAMES, _TRIAL_FRAMES, _SHOWN_FRAMES = 60, 120, 16, 150
"""Numbers of frames of one session that are used; more do not help, because neighbouring frames have similar errors."""
MAX_UNLOADED_N = 0.05
"""Frames with less force show the shape without load."""
MIN_CONTACT_N = 0.03
FREE_CURVATURE_STD_PER_M = 3.0
"""Standard deviation of a frame's pre-curvature about the stated map, while the map is fitted."""
READING_STD_RAD = math.radians(1.5)
"""Standard deviation of an angle that a person reads."""
ANY_ANGLE_STD_RAD = math.pi
MAX_READING_ERROR_RAD = math.radians(10.0)
"""If the sensor seems to be turned by more than this, its stated angle is wrong."""
MAX_SPREAD_RATIO = 0.6
"""And with another angle the difference of readings and lines must decrease by this factor."""
_TURNS_RAD = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
_TARE_STD_N = 2e-3
"""Least standard deviation of the remaining tare, and the assumed one where the tare's is not known."""
_CLOCK_STD_S = {"estimated": 1e-3, "stated": 1e-3, "none": 1e-3, "stage": 5e-3, "refused": 1e-2}
"""Standard deviation of the clock offset, by the method that found it."""
ANGLE_MODEL_STD_RAD = math.radians(0.8)
"""Model error of the sensor's angle."""
STIFFNESS_MODEL_SHARE = 0.02
"""Model error of the stiffness, relative: depth and friction on the dome are not in a planar rod."""
MAX_STD_SHARE = 0.6
"""A value is written if its standard deviation is less than this share of the standard deviation before."""
PROXIMAL_SHARE = 1.0 / 3.0
"""Share of the length that is fitted as the proximal part."""
BENCH_PRIOR = PriorSettings(length=0.015, scale=0.006, tilt_per_m=0.05, precurvature_per_m=0.1, base_angle_deg=1.5)
"""Priors of a bench that is calibrated: a person has measured length and scale and aligned camera and clamp."""
MAX_NOISE_N = 8e-3
MAX_MISFIT = 1.5
"""Mean square of the residual above which the stated rod does not describe the detected shapes."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionResult:
    """Result of one session. A part that could not be found is None, and ``reasons`` states the reason.

    Attributes:
        session: the session.
        knob: map of the knob.
        rod: fit of the rod.
        tissue: fit of the tissue.
        rest: shape of the shaft without load; None: not requested.
        wrong_rad: angle by which the sensor seems to be turned; 0 if it is within a reading error.
        shown: of some frames the time in s, the sensor's force (m, 2) and the force of the calibrated rod (m, 2).
        reasons: part -> reason why it could not be found.
    """

    session: CalibrationSession
    knob: KnobFit | None
    rod: RodFit | None
    tissue: TissueFit | None
    rest: RestShape | None
    wrong_rad: float
    shown: tuple[FloatArray, FloatArray, FloatArray]
    reasons: dict[str, str]

    @property
    def errors_n(self) -> FloatArray:
        """(m, 2) force of the rod less that of the sensor."""
        return self.shown[2] - self.shown[1]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Result of a calibration.

    Attributes:
        quantities: quantities in the order of the table.
        remarks: sentences on quantities that stay unknown.
        sessions: result of each session.
    """

    quantities: tuple[Quantity, ...]
    remarks: tuple[str, ...]
    sessions: tuple[SessionResult, ...]

    def quantity(self, name: str) -> Quantity:
        """Returns the quantity with this name.

        Raises:
            KeyError: the calibration has no such quantity.
        """
        for each in self.quantities:
            if each.name == name:
                return each
        raise KeyError(name)


def calibrate_sessions(
    sessions: Sequence[CalibrationSession],
    *,
    stated_within: float = 0.1,
    rest_shape: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Calibrates one bench and one catheter from ``sessions``.

    Args:
        sessions: results of `read_session`, with forces or all without contact.
        stated_within: relative standard deviation of the stated stiffness.
        rest_shape: whether the curvature along the unloaded shaft is measured.
        progress: called with the share that is done.

    Returns:
        The quantities, the remarks, and the result of each session.

    Raises:
        InputError: length or stiffness of the catheter is not stated.
    """
    settings = RodSettings(prior=BENCH_PRIOR.model_copy(update={"stiffness": min(stated_within, 0.49)}))
    results: list[SessionResult] = []
    for k, session in enumerate(sessions):
        results.append(_of_session(session, settings, rest_shape=rest_shape))
        if progress is not None:
            progress((k + 1) / len(sessions))
    quantities = [
        *_clock(results), *_sensor(results), *_tare(results), *_mass(results), *_knob(results),
        *_stiffness(results, stated_within), *_tissue(results),
    ]  # fmt: skip
    shapes = [each.rest for each in results if each.rest is not None]
    quantities += [rest_quantity(shapes, sessions[0].info)] if shapes else []
    return Calibration(tuple(quantities), _remarks(results, quantities), tuple(results))


def _spread(rows: IntArray, count: int) -> IntArray:
    """Returns at most ``count`` of the ``rows``, evenly spaced."""
    return rows[evenly_spread(len(rows), count)]


def _nominal(info: SessionInfo, knob_deg: FloatArray) -> FloatArray:
    """Returns the (n,) curvature from the stated gain; 0 without a gain."""
    return np.nan_to_num((info.actuation.knob_gain_per_m_deg or 0.0) * knob_deg)


def _of_session(session: CalibrationSession, settings: RodSettings, *, rest_shape: bool) -> SessionResult:
    """Fits one session in five steps: sensor's turn, knob, rest shape, rod, tissue.

    A step that fails leaves None and its reason, and the next steps use the stated values.

    Args:
        session: the session.
        settings: priors and noise of the rod.
        rest_shape: whether the curvature along the unloaded shaft is fitted too.
    """
    reasons: dict[str, str] = {}
    no_frames = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2))
    known = np.flatnonzero(np.isfinite(session.force_n).all(axis=1))
    if not len(known):
        reasons["rod"] = "no frame has a force"
        return SessionResult(session, None, None, None, None, 0.0, no_frames, reasons)
    force_size_n = np.linalg.norm(session.force_n[known], axis=1)
    knob = rod = tissue = rest = None
    turn = _turn(session, known[force_size_n > MIN_CONTACT_N], settings)
    wrong_rad = turn if abs(turn) > MAX_READING_ERROR_RAD else 0.0
    unloaded = _spread(known[force_size_n < MAX_UNLOADED_N], _KNOB_FRAMES)
    transmitted_deg = session.knob_deg
    try:
        knob, transmitted_deg = _knob_of(session, unloaded, settings, wrong_rad)
    except InputError as error:
        reasons["knob"] = str(error)
    curvature = _nominal(session.info, session.knob_deg)
    drift = None
    if knob is not None and math.isfinite(knob.gain_per_m_deg):
        curvature = knob.curvature_at(transmitted_deg)
        drift = max(knob.residual_per_m, MIN_DRIFT_PER_M)
    if rest_shape:
        offset = 0.0 if drift is not None else session.info.actuation.knob_offset_per_m or 0.0
        lines = [session.lines[row] for row in unloaded.tolist()]
        try:
            rest = fit_rest_shape(session.info, lines, curvature[unloaded] + offset, session.scale_m_per_px)
        except InputError as error:
            reasons["rest shape"] = str(error)
    rows = _spread(known, _ROD_FRAMES)
    try:
        rod = _fit(session, rows, curvature, settings, wrong_rad, drift_per_m=drift)
    except InputError as error:
        reasons["rod"] = str(error)
    if wrong_rad:
        reasons["tissue"] = "not fitted while the sensor's angle is wrong; calibrate again with the new one"
    elif bool((force_size_n > MIN_CONTACT_N).any()):
        try:
            tissue = fit_tissue(session)
        except InputError as error:
            reasons["tissue"] = str(error)
    shown = no_frames
    if rod is not None:
        rows = _spread(known, _SHOWN_FRAMES)
        rod_forces = line_forces(
            session.info, [session.lines[k] for k in rows.tolist()], session.scale_m_per_px, curvature[rows], rod,
            settings,
        )  # fmt: skip
        c, s = math.cos(rod.turn_rad), math.sin(rod.turn_rad)  # turns the readings to the corrected angle
        shown = session.seconds[rows], session.force_n[rows] @ np.array([[c, s], [-s, c]]), rod_forces
    return SessionResult(session, knob, rod, tissue, rest, wrong_rad, shown, reasons)


def _fit(
    session: CalibrationSession, rows: IntArray, curvature: FloatArray, settings: RodSettings, wrong_rad: float, *,
    drift_per_m: float | None = None, turn_std_rad: float | None = None,
) -> RodFit:  # fmt: skip
    """Fits the rod to the frames ``rows`` of a session.

    Args:
        session: the session.
        rows: the frames that are used.
        curvature: (all frames,) pre-curvature that the knob sets, 1/m.
        settings: priors and noise of the rod.
        wrong_rad: turn of the sensor at which the fit starts; where it is not 0, its prior is wide.
        drift_per_m: standard deviation of a frame's pre-curvature about the session's; see `fit_rod`.
        turn_std_rad: standard deviation of the sensor's angle; None: that of a reading, or wide.
    """
    part = session.subset(rows)
    stderr = part.tare.stderr_n
    offset = part.clock_map
    late = math.hypot(_CLOCK_STD_S[offset.how], 1e-3 * offset.stderr_ms if offset.how == "estimated" else 0.0)
    return fit_rod(
        part.info, part.lines, part.scale_m_per_px, part.force_n, curvature[rows], past_n=part.past_n,
        rate_n_per_s=part.rate_n_per_s, turn_rad=wrong_rad,
        turn_std_rad=turn_std_rad or (ANY_ANGLE_STD_RAD if wrong_rad else READING_STD_RAD),
        tare_std_n=math.hypot(_TARE_STD_N, float(np.nanmax(stderr)) if np.isfinite(stderr).any() else _TARE_STD_N),
        late_std_s=late, drift_per_m=drift_per_m, settings=settings,
    )  # fmt: skip


def _turn(session: CalibrationSession, touching: IntArray, settings: RodSettings) -> float:
    """Returns the angle in rad by which the sensor seems to be turned; 0 if the frames do not show one.

    The rod is fitted from four starts 90 deg apart. A fit replaces the stated angle only where the difference of
    readings and lines is below `MAX_SPREAD_RATIO` of that at the stated angle, and its own angle is determined.

    Args:
        session: the session.
        touching: rows of the frames in contact.
        settings: priors and noise of the rod.
    """
    rows = _spread(touching, _TRIAL_FRAMES)
    if len(rows) < _TRIAL_FRAMES:
        return 0.0
    curvature = _nominal(session.info, session.knob_deg)
    best_rad, least_std_n = 0.0, math.inf
    try:
        least_std_n = MAX_SPREAD_RATIO * _fit(session, rows, curvature, settings, 0.0).force_std_n
    except InputError:
        least_std_n = math.inf  # there is no fit at the stated angle, so any other one is better
    for turn in _TURNS_RAD:
        try:
            fit = _fit(session, rows, curvature, settings, turn, turn_std_rad=ANY_ANGLE_STD_RAD)
        except InputError:
            continue
        if fit.force_std_n < least_std_n and fit.turn_std_rad < MAX_READING_ERROR_RAD:
            best_rad, least_std_n = fit.turn_rad, fit.force_std_n
    return math.remainder(best_rad, 2.0 * math.pi)


def _knob_of(
    session: CalibrationSession, rows: IntArray, settings: RodSettings, wrong_rad: float
) -> tuple[KnobFit, FloatArray]:
    """Returns the knob's map, and the knob angle behind its play at all frames."""
    if not len(rows):
        raise InputError("no frame has little force, so the shape without load is not known")
    nominal = _nominal(session.info, session.knob_deg)
    fit = _fit(session, rows, nominal, settings, wrong_rad, drift_per_m=FREE_CURVATURE_STD_PER_M)
    kept = rows[fit.kept]  # without the outliers of the fit
    knob = fit_knob(
        session.knob_series, session.stamp_ns[kept], fit.precurvature_per_m, fit.precurvature_std,
        common_std_per_m=fit.std("precurvature_per_m"),
    )  # fmt: skip
    return knob, knob.through(session.knob_series, session.stamp_ns)


def _clock(results: Sequence[SessionResult]) -> list[Quantity]:
    """Returns the clock offset of each session in which it was searched for; NaN where the search was refused."""
    searched = [each.session for each in results if each.session.clock_map.how in ("estimated", "stage", "refused")]
    quantities: list[Quantity] = []
    for session in searched:
        offset = session.clock_map
        is_estimated = offset.how == "estimated"
        name = f"clock offset, {session.name}" if len(results) > 1 else "clock offset"
        value = math.nan if offset.how == "refused" else offset.offset_ms
        std = offset.stderr_ms if is_estimated else math.nan
        doubt = "" if is_estimated else offset.detail or "from the stage's movement, accurate to some milliseconds"
        quantities.append(Quantity(name, value, std, "ms", len(session.stamp_ns), doubt=doubt))
    return quantities


def _sensor(results: Sequence[SessionResult]) -> list[Quantity]:
    """Returns the sensor's angle in degrees: the stated one plus the mean turn of the sessions with contact.

    It is written if it is more accurate than a person's reading, if no angle is stated, or if the stated one does not
    fit. A turn by 180 deg cannot be distinguished from a sensor that reads the opposite force.
    """
    rods = [(each, each.rod) for each in results if each.rod is not None and _touches(each)]
    if not rods:
        return []
    stated = rods[0][0].session.info.sensor
    prior = READING_STD_RAD if not any(each.wrong_rad for each, _ in rods) else math.inf
    turn, std = combined([rod.turn_rad for _, rod in rods], [rod.turn_std_rad for _, rod in rods], prior)
    stated_deg = stated.angle_deg
    value = math.degrees(math.remainder(math.radians(stated_deg or 0.0) + turn, 2.0 * math.pi))
    std = math.hypot(std, ANGLE_MODEL_STD_RAD)
    written = (
        std / READING_STD_RAD < MAX_STD_SHARE or stated_deg is None or abs(turn) > max(MAX_READING_ERROR_RAD, 3.0 * std)
    )
    doubt = "" if written else "not more accurate than a person's reading; the stated angle stays"
    if len({each.session.info.sensor.angle_deg for each, _ in rods}) > 1:
        written, doubt = False, "the recordings state different angles: calibrate them one by one"
    reads = stated.reads or "tip-on-tissue"
    if abs(turn) > MAX_READING_ERROR_RAD:
        opposite = "tissue-on-tip" if reads == "tip-on-tissue" else "tip-on-tissue"
        doubt = f"the stated angle does not fit: turned by {math.degrees(turn):+.0f} deg"
        if abs(abs(turn) - math.pi) < MAX_READING_ERROR_RAD:
            doubt += f", or the sensor reads {opposite}"
    elif stated_deg is None:
        doubt = f"assumed that it reads {reads}; with the opposite it is {value + 180.0:.0f} deg"
    frames = sum(rod.frames for _, rod in rods)
    return [
        Quantity(
            "sensor angle", value, math.degrees(std), "deg", frames, "sensor.angle_deg", stated_deg, written, doubt
        )
    ]


def _touches(result: SessionResult) -> bool:
    size = np.linalg.norm(result.session.force_n, axis=1)
    return bool((size > MIN_CONTACT_N).sum() >= _TRIAL_FRAMES)


def _tare(results: Sequence[SessionResult]) -> list[Quantity]:
    """Returns the tare of the session in which it is least accurate, as its magnitude in mN."""
    worst = [
        (float(np.nanmax(each.session.tare.stderr_n)), each.session)
        for each in results
        if each.session.tare.how != "none" and np.isfinite(each.session.tare.stderr_n).any()
    ]
    if not worst:
        return []
    stderr, session = max(worst, key=lambda pair: pair[0])
    size = 1e3 * float(np.linalg.norm(session.tare.force_n))
    doubt = session.tare.detail if stderr < 5e-3 else "the contact-free stretch is not quiet: state sensor.no_contact_s"
    return [Quantity("tare", size, 1e3 * stderr, "mN", len(session.stamp_ns), doubt=doubt)]


def _mass(results: Sequence[SessionResult]) -> list[Quantity]:
    """Returns the mass that the sensor carries in kg, combined over the stage's axes of all sessions."""
    masses: list[float] = []
    stds: list[float] = []
    frames = 0
    for each in results:
        for gain, std in zip(each.session.inertia.gain_kg, each.session.mass_std_kg.tolist(), strict=True):
            masses.append(float(np.linalg.norm(gain)))
            stds.append(std)
        if len(each.session.inertia.gain_kg):
            frames += len(each.session.stamp_ns)
    if not masses:
        return []
    mass, std = combined(masses, stds)
    return [
        Quantity(
            "moving mass", mass, std, "kg", frames, "sensor.moving_mass_kg",
            results[0].session.info.sensor.moving_mass_kg, std < 0.2 * mass,
            "" if std < 0.2 * mass else "the stage accelerates too little without contact",
        )
    ]  # fmt: skip


def _knob(results: Sequence[SessionResult]) -> list[Quantity]:
    """Combines the fits of the knob of all sessions.

    Args:
        results: results of the sessions.

    Returns:
        Gain in 1/m/deg, offset in 1/m and hysteresis in degrees. If the knob was at one angle only: the curvature there
        in 1/m. Nothing without a fit.
    """
    knobs = [each.knob for each in results if each.knob is not None]
    info = results[0].session.info
    if not knobs:
        return []
    maps = [knob for knob in knobs if math.isfinite(knob.gain_per_m_deg)]
    frames = sum(knob.frames for knob in knobs)
    low, high = min(knob.low_deg for knob in knobs), max(knob.high_deg for knob in knobs)
    if not maps:
        value, std = combined([k.curvature_per_m for k in knobs], [k.curvature_std for k in knobs])
        doubt = (
            f"the knob stayed at {low:g} deg, so gain and hysteresis are unknown; turn it up and down without contact"
        )
        expected = info.actuation.curvature_per_m(low)
        return [Quantity(f"pre-curvature at {low:g} deg", value, std, "1/m", frames, before=expected, doubt=doubt)]
    gain, gain_std = combined([k.gain_per_m_deg for k in maps], [k.gain_std for k in maps])
    offset, offset_std = combined([k.offset_per_m for k in maps], [k.offset_std for k in maps])
    is_accurate = gain_std < 0.1 * abs(gain)
    note = "" if is_accurate else f"from {low:.0f} to {high:.0f} deg only"
    quantities = [
        Quantity(
            "knob gain", gain, gain_std, "1/m/deg", frames, "actuation.knob_gain_per_m_deg",
            info.actuation.knob_gain_per_m_deg, is_accurate, note,
        ),
        Quantity(
            "knob offset", offset, offset_std, "1/m", frames, "actuation.knob_offset_per_m",
            info.actuation.knob_offset_per_m, is_accurate, note,
        ),
    ]  # fmt: skip
    plays = [k for k in maps if math.isfinite(k.play_deg)]
    if plays:
        play, play_std = combined([k.play_deg for k in plays], [max(k.play_std, 0.05) for k in plays])
        is_determined = play_std < 1.0
        doubt = "" if is_determined else "the knob was turned back too little"
        quantities.append(
            Quantity("knob hysteresis", play, play_std, "deg", frames, "actuation.knob_play_deg",
                     info.actuation.knob_play_deg, is_determined, doubt)
        )  # fmt: skip
    else:
        quantities.append(
            Quantity("knob hysteresis", math.nan, math.nan, "deg", frames, doubt="the knob was never turned back")
        )
    return quantities


def _stiffness(results: Sequence[SessionResult], stated_within: float) -> list[Quantity]:
    """Combines the stiffness of the sessions with contact.

    Args:
        results: results of the sessions.
        stated_within: relative standard deviation of the stated stiffness.

    Returns:
        Bending stiffness, its increase next to the base in %, and its growth with curvature. Nothing without contact.
    """
    rods = [each.rod for each in results if each.rod is not None and _touches(each)]
    info = results[0].session.info
    stated = info.catheter.bending_stiffness_nm2
    if not rods or stated is None:
        return []
    frames = sum(rod.frames for rod in rods)
    change, std = combined([r.value("stiffness") for r in rods], [r.std("stiffness") for r in rods], stated_within)
    std = math.hypot(std, STIFFNESS_MODEL_SHARE)
    written = std < MAX_STD_SHARE * stated_within
    doubt = "" if written else "the frames determine it too little; the stated value stays"
    noise = max(rod.force_std_n for rod in rods)
    if noise > MAX_NOISE_N:
        doubt = (doubt + "; " if doubt else "") + f"sensor and lines differ by {1e3 * noise:.0f} mN: clock or inertia"
    misfit = max(rod.misfit for rod in rods)
    if misfit > MAX_MISFIT:
        doubt = (
            doubt + "; " if doubt else ""
        ) + f"lines differ from the rod, misfit {misfit:.1f}: check length and scale"
        written = False
    quantities = [
        Quantity(
            "bending stiffness", stated * (1.0 + change), stated * std, "N m^2", frames,
            "catheter.bending_stiffness_nm2", stated, written, doubt,
        )
    ]  # fmt: skip
    prior = rods[0].prior("proximal_stiffness")
    proximal, proximal_std = combined(
        [r.value("proximal_stiffness") for r in rods], [r.std("proximal_stiffness") for r in rods], prior
    )
    proximal_std = math.hypot(proximal_std, 0.01)
    is_accurate = proximal_std < MAX_STD_SHARE * prior and abs(proximal) > 2.0 * proximal_std
    is_shown = is_accurate and not info.catheter.stiffness_profile
    edge = round(PROXIMAL_SHARE, 3)
    factor = round(1.0 + proximal, 4)
    profile = [[0.0, factor], [edge, factor], [round(edge + 0.001, 4), 1.0], [1.0, 1.0]]
    quantities.append(
        Quantity(
            "stiffer next to the base", 100.0 * proximal, 100.0 * proximal_std, "%", frames,
            "catheter.stiffness_profile" if is_shown else "", None, is_shown,
            "" if is_shown else "not distinguishable from an even shaft" if not info.catheter.stiffness_profile
            else "in addition to the stated profile", stated=profile,
        )
    )  # fmt: skip
    growth, growth_std = combined([r.value("stiffening_m2") for r in rods], [r.std("stiffening_m2") for r in rods])
    share_left = growth_std / rods[0].prior("stiffening_m2")
    doubt = "" if share_left < MAX_STD_SHARE else "the shaft bends too little to determine it"
    quantities.append(
        Quantity("stiffening with curvature", 1e4 * growth, 1e4 * growth_std, "1e-4 m^2", frames, doubt=doubt)
    )
    return quantities


def _tissue(results: Sequence[SessionResult]) -> list[Quantity]:
    """Returns the tissue's stiffness and the exponent of its law, combined over the sessions that determine them."""
    fits = [each.tissue for each in results if each.tissue is not None]
    if not fits:
        return []
    value, std = combined([each.stiffness_n_per_m for each in fits], [each.stiffness_std for each in fits])
    exponent, exponent_std = combined([each.exponent for each in fits], [each.exponent_std for each in fits])
    frames = sum(each.frames for each in fits)
    slide = max(each.slide for each in fits)
    doubt = ""
    if std > 0.15 * value:
        doubt = f"the tip slides {slide:.1f} times as far as it is pressed in"
    quantities = [
        Quantity("tissue stiffness", value, std, "N/m", frames, "tissue.stiffness_n_per_m",
                 results[0].session.info.tissue.stiffness_n_per_m, std < 0.25 * value, doubt)
    ]  # fmt: skip
    is_determined = exponent_std < 0.15
    doubt = "" if is_determined else "not determined"
    quantities.append(Quantity("tissue law's exponent", exponent, exponent_std, "", frames, doubt=doubt))
    return quantities


def _remarks(results: Sequence[SessionResult], quantities: Sequence[Quantity]) -> tuple[str, ...]:
    """Returns the sentences below the table: unknown quantities, failed steps, lost frames, and the rod's error."""
    remarks: list[str] = []
    names = {each.name for each in quantities}
    info = results[0].session.info
    if "bending stiffness" not in names:
        stiffness = info.catheter.bending_stiffness_nm2 or math.nan
        remarks.append(
            f"the stated stiffness of {stiffness:.3g} N m^2 was not checked, because no frame has a force in contact: "
            "an error of 5 % is 5 % of every force"
        )
        remarks.append("sensor angle, tare, moving mass and tissue stay unknown: they need a recording with forces")
    for each in results:
        for part, reason in each.reasons.items():
            remarks.append(f"{each.session.name}: {part}: {reason}")
        lost = 1.0 - len(each.session.stamp_ns) / max(each.session.frames, 1)
        if lost > 0.1:
            remarks.append(f"{each.session.name}: the catheter is not detected in {lost:.0%} of the frames")
    errors = [each.errors_n for each in results if len(each.shown[0]) and _touches(each)]
    if errors:
        differences = np.concatenate(errors)
        differences = differences[np.isfinite(differences).all(axis=1)]
        rms = 1e3 * np.sqrt(np.mean(differences**2, axis=0))
        remarks.append(
            f"sensor and calibrated rod differ by {rms[0]:.0f} mN in x and {rms[1]:.0f} mN in y (RMS over "
            f"{len(differences)} frames of these recordings; the figure that counts is that of other sessions: "
            "`tipforce evaluate rod`)"
        )
    return tuple(remarks)
