"""All that recordings tell of a bench: each session by itself, then what they have in common."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..estimators.rod import PriorSettings, RodSettings
from ..types import FloatArray, IntArray, SessionInfo
from ._knob import KnobFit, fit_knob
from ._quantity import Quantity, combined
from ._rod_fit import RodFit, fit_rod, line_forces
from ._session import CalibrationSession
from ._tissue import TissueFit, fit_tissue

_ROD_FRAMES, _KNOB_FRAMES, _TRIAL_FRAMES, _SHOWN_FRAMES = 60, 120, 16, 150
"""Frames of one session that are used: neighbouring frames err alike, more of them only seem to tell more."""
_LIGHT_N = 0.05
"""Frames with less force tell the shape without load."""
_CONTACT_N = 0.03
_FREE_CURVATURE_PER_M = 3.0
"""How far a frame's pre-curvature may be off the stated map while the map is looked for."""
_POSE_STD_RAD = math.radians(1.5)
"""Of an angle that a person reads off."""
_ANY_STD_RAD = math.pi
_WRONG_RAD = math.radians(10.0)
"""A sensor that seems turned by more is stated wrongly."""
_BETTER = 0.6
"""And by another angle readings and lines must come nearer to one another by this factor."""
_TURNS_RAD = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
_CLOCK_STD_S = {"estimated": 1e-3, "stated": 1e-3, "none": 1e-3, "stage": 5e-3, "refused": 1e-2}
_ANGLE_MODEL_RAD = math.radians(0.8)
"""Of the sensor's angle: the same."""
_MODEL_SHARE = 0.02
"""Of the stiffness: what a rod in the plane leaves out (depth, friction on the dome), whatever the frames say."""
_TOLD = 0.6
"""A value is written where the data leave less than this share of what was not known before."""
_PROXIMAL = 1.0 / 3.0
"""Share of the length that is fitted as the proximal part."""
_SET_UP = PriorSettings(length=0.015, scale=0.006, tilt_per_m=0.05)
"""Of a bench that is being calibrated: somebody has measured its length and scale, and put the camera square to it."""
_NOISY_N = 8e-3
_LARGE_MISFIT = 1.5
"""Mean square: a rod as it is stated does not take the shapes that are detected."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionResult:
    """Of one session. What could not be found is None, and ``reasons`` says why.

    ``wrong_rad``: by how much the sensor seems turned where that is more than a reading error. ``shown``: of some
    frames their seconds, what the sensor reads and what the calibrated rod makes of the line, (m, 2) each.
    """

    session: CalibrationSession
    knob: KnobFit | None
    rod: RodFit | None
    tissue: TissueFit | None
    wrong_rad: float
    shown: tuple[FloatArray, FloatArray, FloatArray]
    reasons: dict[str, str]

    @property
    def errors_n(self) -> FloatArray:
        """(m, 2): the rod's force less the sensor's."""
        return self.shown[2] - self.shown[1]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """``quantities`` in the order of a table; ``remarks``: whole sentences on what stays unknown."""

    quantities: tuple[Quantity, ...]
    remarks: tuple[str, ...]
    sessions: tuple[SessionResult, ...]

    def quantity(self, name: str) -> Quantity:
        """By its name. Raises KeyError."""
        for each in self.quantities:
            if each.name == name:
                return each
        raise KeyError(name)


def calibrate_sessions(
    sessions: Sequence[CalibrationSession],
    *,
    stated_within: float = 0.1,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """What ``sessions`` of one bench and one catheter tell.

    Args:
        sessions: of `read_session`; with forces, or all contact-free.
        stated_within: standard deviation of the stated stiffness, relative.
        progress: called with the share that is done.

    Raises:
        InputError: length or stiffness of the catheter is not stated.
    """
    settings = RodSettings(prior=_SET_UP.model_copy(update={"stiffness": min(stated_within, 0.49)}))
    results: list[SessionResult] = []
    for k, session in enumerate(sessions):
        results.append(_of_session(session, settings))
        if progress is not None:
            progress((k + 1) / len(sessions))
    quantities = [
        *_clock(results), *_sensor(results), *_tare(results), *_mass(results), *_knob(results),
        *_stiffness(results, stated_within), *_tissue(results),
    ]  # fmt: skip
    return Calibration(tuple(quantities), _remarks(results, quantities), tuple(results))


def _spread(rows: IntArray, count: int) -> IntArray:
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).astype(np.int64))] if len(rows) else rows


def _nominal(info: SessionInfo, knob_deg: FloatArray) -> FloatArray:
    """(n,) curvature that the stated gain asks for; 0 without one."""
    return np.nan_to_num((info.actuation.knob_gain_per_m_deg or 0.0) * knob_deg)


def _of_session(session: CalibrationSession, settings: RodSettings) -> SessionResult:
    reasons: dict[str, str] = {}
    nothing = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2))
    known = np.flatnonzero(np.isfinite(session.force_n).all(axis=1))
    if not len(known):
        reasons["rod"] = "no frame has a force"
        return SessionResult(session, None, None, None, 0.0, nothing, reasons)
    size = np.linalg.norm(session.force_n[known], axis=1)
    knob = rod = tissue = None
    turn = _turn(session, known[size > _CONTACT_N], settings)
    wrong = turn if abs(turn) > _WRONG_RAD else 0.0
    light = _spread(known[size < _LIGHT_N], _KNOB_FRAMES)
    through = session.knob_deg
    try:
        knob, through = _knob_of(session, light, settings, wrong)
    except InputError as error:
        reasons["knob"] = str(error)
    curvature = _nominal(session.info, session.knob_deg)
    drift = None
    if knob is not None and math.isfinite(knob.gain_per_m_deg):
        curvature = knob.curvature_at(through)
        drift = max(knob.residual_per_m, 0.02)
    rows = _spread(known, _ROD_FRAMES)
    try:
        rod = _fit(session, rows, curvature, settings, wrong, drift_per_m=drift)
    except InputError as error:
        reasons["rod"] = str(error)
    if wrong:
        reasons["tissue"] = "not looked for while the sensor's angle is wrong; calibrate again with the new one"
    elif bool((size > _CONTACT_N).any()):
        try:
            tissue = fit_tissue(session)
        except InputError as error:
            reasons["tissue"] = str(error)
    shown = nothing
    if rod is not None:
        others = _spread(known, _SHOWN_FRAMES)
        told = line_forces(
            session.info, [session.lines[k] for k in others.tolist()], session.scale_m_per_px, curvature[others], rod,
            settings,
        )  # fmt: skip
        c, s = math.cos(rod.turn_rad), math.sin(rod.turn_rad)
        shown = session.seconds[others], session.force_n[others] @ np.array([[c, s], [-s, c]]), told
    return SessionResult(session, knob, rod, tissue, wrong, shown, reasons)


def _fit(
    session: CalibrationSession, rows: IntArray, curvature: FloatArray, settings: RodSettings, wrong_rad: float, *,
    drift_per_m: float | None = None, turn_std_rad: float | None = None,
) -> RodFit:  # fmt: skip
    part = session.subset(rows)
    stderr = part.tare.stderr_n
    offset = part.clock_map
    late = math.hypot(_CLOCK_STD_S[offset.how], 1e-3 * offset.stderr_ms if offset.how == "estimated" else 0.0)
    return fit_rod(
        part.info,
        part.lines,
        part.scale_m_per_px,
        part.force_n,
        curvature[rows],
        past_n=part.past_n,
        rate_n_per_s=part.rate_n_per_s,
        turn_rad=wrong_rad,
        turn_std_rad=turn_std_rad or (_ANY_STD_RAD if wrong_rad else _POSE_STD_RAD),
        tare_std_n=math.hypot(2e-3, float(np.nanmax(stderr)) if np.isfinite(stderr).any() else 2e-3),
        late_std_s=late,
        drift_per_m=drift_per_m,
        settings=settings,
    )


def _turn(session: CalibrationSession, touching: IntArray, settings: RodSettings) -> float:
    """By how much the sensor's stated angle seems wrong, rad; 0 where the frames do not tell."""
    rows = _spread(touching, _TRIAL_FRAMES)
    if len(rows) < _TRIAL_FRAMES:
        return 0.0
    curvature = _nominal(session.info, session.knob_deg)
    best, least = 0.0, math.inf
    try:
        least = _BETTER * _fit(session, rows, curvature, settings, 0.0).force_std_n
    except InputError:
        least = math.inf  # at the stated angle there is no fit at all: any other is better
    for turn in _TURNS_RAD:
        try:
            found = _fit(session, rows, curvature, settings, turn, turn_std_rad=_ANY_STD_RAD)
        except InputError:
            continue
        if found.force_std_n < least and found.turn_std_rad < _WRONG_RAD:
            best, least = found.turn_rad, found.force_std_n
    return math.remainder(best, 2.0 * math.pi)


def _knob_of(
    session: CalibrationSession, rows: IntArray, settings: RodSettings, wrong_rad: float
) -> tuple[KnobFit, FloatArray]:
    """The knob's map, and what its play lets through at all frames."""
    if not len(rows):
        raise InputError("no frame has little force: the shape without load does not show")
    fit = _fit(
        session, rows, _nominal(session.info, session.knob_deg), settings, wrong_rad, drift_per_m=_FREE_CURVATURE_PER_M
    )
    kept = rows[fit.kept]
    knob = fit_knob(
        session.knob_series, session.stamp_ns[kept], fit.precurvature_per_m, fit.precurvature_std,
        common_std_per_m=fit.std("precurvature_per_m"),
    )  # fmt: skip
    return knob, knob.through(session.knob_series, session.stamp_ns)


def _clock(results: Sequence[SessionResult]) -> list[Quantity]:
    found = [each.session for each in results if each.session.clock_map.how in ("estimated", "stage", "refused")]
    made: list[Quantity] = []
    for session in found:
        offset = session.clock_map
        told = offset.how == "estimated"
        made.append(
            Quantity(
                f"clock offset, {session.name}" if len(results) > 1 else "clock offset",
                math.nan if offset.how == "refused" else offset.offset_ms,
                offset.stderr_ms if told else math.nan,
                "ms",
                len(session.stamp_ns),
                doubt="" if told else offset.detail or "from the stage's movement, good to some milliseconds",
            )
        )
    return made


def _sensor(results: Sequence[SessionResult]) -> list[Quantity]:
    rods = [(each, each.rod) for each in results if each.rod is not None and _touches(each)]
    if not rods:
        return []
    stated = rods[0][0].session.info.sensor
    prior = _POSE_STD_RAD if not any(each.wrong_rad for each, _ in rods) else math.inf
    turn, std = combined([rod.turn_rad for _, rod in rods], [rod.turn_std_rad for _, rod in rods], prior)
    before = stated.angle_deg
    value = math.degrees(math.remainder(math.radians(before or 0.0) + turn, 2.0 * math.pi))
    std = math.hypot(std, _ANGLE_MODEL_RAD)
    told = std / _POSE_STD_RAD < _TOLD or before is None or abs(turn) > max(_WRONG_RAD, 3.0 * std)
    doubt = "" if told else "told no better than a person reads it off; the stated angle stays"
    if len({each.session.info.sensor.angle_deg for each, _ in rods}) > 1:
        told, doubt = False, "the recordings state different angles: calibrate them one by one"
    reads = stated.reads or "tip-on-tissue"
    if abs(turn) > _WRONG_RAD:
        other = "tissue-on-tip" if reads == "tip-on-tissue" else "tip-on-tissue"
        doubt = f"the stated angle does not fit: turned by {math.degrees(turn):+.0f} deg"
        if abs(abs(turn) - math.pi) < _WRONG_RAD:
            doubt += f", or the sensor reads {other}"
    elif before is None:
        doubt = f"taken that it reads {reads}; with the opposite it is {value + 180.0:.0f} deg"
    frames = sum(rod.frames for _, rod in rods)
    return [Quantity("sensor angle", value, math.degrees(std), "deg", frames, "sensor.angle_deg", before, told, doubt)]


def _touches(result: SessionResult) -> bool:
    size = np.linalg.norm(result.session.force_n, axis=1)
    return bool((size > _CONTACT_N).sum() >= _TRIAL_FRAMES)


def _tare(results: Sequence[SessionResult]) -> list[Quantity]:
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
    masses: list[float] = []
    stds: list[float] = []
    frames = 0
    for each in results:
        for gain, std in zip(each.session.inertia.gain_kg, each.session.mass_std_kg.tolist(), strict=True):
            masses.append(float(np.linalg.norm(gain)))
            stds.append(std)
            frames = len(each.session.stamp_ns)
    if not masses:
        return []
    mass, std = combined(masses, stds)
    return [
        Quantity(
            "moving mass", mass, std, "kg", frames, "sensor.moving_mass_kg",
            results[0].session.info.sensor.moving_mass_kg, std < 0.2 * mass,
            "" if std < 0.2 * mass else "the stage hardly accelerates without contact",
        )
    ]  # fmt: skip


def _knob(results: Sequence[SessionResult]) -> list[Quantity]:
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
            f"the knob stood at {low:g} deg: neither gain nor hysteresis is told; turn it up and down without contact"
        )
        expected = info.actuation.curvature_per_m(low)
        return [Quantity(f"pre-curvature at {low:g} deg", value, std, "1/m", frames, before=expected, doubt=doubt)]
    gain, gain_std = combined([k.gain_per_m_deg for k in maps], [k.gain_std for k in maps])
    offset, offset_std = combined([k.offset_per_m for k in maps], [k.offset_std for k in maps])
    good = gain_std < 0.1 * abs(gain)
    note = "" if good else f"from {low:.0f} to {high:.0f} deg only"
    made = [
        Quantity(
            "knob gain", gain, gain_std, "1/m/deg", frames, "actuation.knob_gain_per_m_deg",
            info.actuation.knob_gain_per_m_deg, good, note,
        ),
        Quantity(
            "knob offset", offset, offset_std, "1/m", frames, "actuation.knob_offset_per_m",
            info.actuation.knob_offset_per_m, good, note,
        ),
    ]  # fmt: skip
    plays = [k for k in maps if math.isfinite(k.play_deg)]
    if plays:
        play, play_std = combined([k.play_deg for k in plays], [max(k.play_std, 0.05) for k in plays])
        fine = play_std < 1.0
        doubt = "" if fine else "the knob turned too little to and fro"
        made.append(
            Quantity("knob hysteresis", play, play_std, "deg", frames, "actuation.knob_play_deg",
                     info.actuation.knob_play_deg, fine, doubt)
        )  # fmt: skip
    else:
        made.append(Quantity("knob hysteresis", math.nan, math.nan, "deg", frames, doubt="the knob never turned back"))
    return made


def _stiffness(results: Sequence[SessionResult], stated_within: float) -> list[Quantity]:
    rods = [each.rod for each in results if each.rod is not None and _touches(each)]
    info = results[0].session.info
    stated = info.catheter.bending_stiffness_nm2
    if not rods or stated is None:
        return []
    frames = sum(rod.frames for rod in rods)
    share, std = combined([r.value("stiffness") for r in rods], [r.std("stiffness") for r in rods], stated_within)
    std = math.hypot(std, _MODEL_SHARE)
    told = std < _TOLD * stated_within
    doubt = "" if told else "the frames hardly tell it; the stated value stays"
    noise = max(rod.force_std_n for rod in rods)
    if noise > _NOISY_N:
        doubt = (doubt + "; " if doubt else "") + f"sensor and lines are {1e3 * noise:.0f} mN apart: clock or inertia"
    misfit = max(rod.misfit for rod in rods)
    if misfit > _LARGE_MISFIT:
        doubt = (doubt + "; " if doubt else "") + f"lines are off the rod, misfit {misfit:.1f}: check length and scale"
        told = False
    made = [
        Quantity(
            "bending stiffness", stated * (1.0 + share), stated * std, "N m^2", frames,
            "catheter.bending_stiffness_nm2", stated, told, doubt,
        )
    ]  # fmt: skip
    prior = rods[0].prior("proximal_stiffness")
    more, more_std = combined(
        [r.value("proximal_stiffness") for r in rods], [r.std("proximal_stiffness") for r in rods], prior
    )
    more_std = math.hypot(more_std, 0.01)
    shown = more_std < _TOLD * prior and abs(more) > 2.0 * more_std and not info.catheter.stiffness_profile
    edge = round(_PROXIMAL, 3)
    profile = [[0.0, round(1.0 + more, 4)], [edge, round(1.0 + more, 4)], [round(edge + 0.001, 4), 1.0], [1.0, 1.0]]
    made.append(
        Quantity(
            "stiffer next to the base", 100.0 * more, 100.0 * more_std, "%", frames,
            "catheter.stiffness_profile" if shown else "", None, shown,
            "" if shown else "not told apart from an even shaft" if not info.catheter.stiffness_profile
            else "beside the stated profile", stated=profile,
        )
    )  # fmt: skip
    soft, soft_std = combined(
        [r.value("stiffening_m2") for r in rods], [r.std("stiffening_m2") for r in rods],
    )  # fmt: skip
    left = soft_std / rods[0].prior("stiffening_m2")
    doubt = "" if left < _TOLD else "the shaft bends too little to tell it"
    made.append(Quantity("stiffening with curvature", 1e4 * soft, 1e4 * soft_std, "1e-4 m^2", frames, doubt=doubt))
    return made


def _tissue(results: Sequence[SessionResult]) -> list[Quantity]:
    found = [each.tissue for each in results if each.tissue is not None]
    if not found:
        return []
    value, std = combined([each.stiffness_n_per_m for each in found], [each.stiffness_std for each in found])
    exponent, exponent_std = combined([each.exponent for each in found], [each.exponent_std for each in found])
    frames = sum(each.frames for each in found)
    slide = max(each.slide for each in found)
    doubt = ""
    if std > 0.15 * value:
        doubt = f"the tip slides {slide:.1f} times as far as it presses in"
    made = [
        Quantity("tissue stiffness", value, std, "N/m", frames, "tissue.stiffness_n_per_m",
                 results[0].session.info.tissue.stiffness_n_per_m, std < 0.25 * value, doubt)
    ]  # fmt: skip
    told = exponent_std < 0.15
    what = "1 is a spring" if told else "not told"
    made.append(Quantity("tissue law's exponent", exponent, exponent_std, "", frames, doubt=what if not told else ""))
    return made


def _remarks(results: Sequence[SessionResult], quantities: Sequence[Quantity]) -> tuple[str, ...]:
    said: list[str] = []
    names = {each.name for each in quantities}
    info = results[0].session.info
    if "bending stiffness" not in names:
        stiffness = info.catheter.bending_stiffness_nm2 or math.nan
        said.append(
            f"the stated stiffness of {stiffness:.3g} N m^2 was not checked, for no frame has a force in contact: an "
            "error of 5 % is 5 % of every force"
        )
        said.append("sensor angle, tare, moving mass and tissue stay unknown: they need a recording with forces")
    for each in results:
        for what, reason in each.reasons.items():
            said.append(f"{each.session.name}: {what}: {reason}")
        lost = 1.0 - len(each.session.stamp_ns) / max(each.session.frames, 1)
        if lost > 0.1:
            said.append(f"{each.session.name}: the catheter is not detected in {lost:.0%} of the frames")
    errors = [each.errors_n for each in results if len(each.shown[0]) and _touches(each)]
    if errors:
        apart = np.concatenate(errors)
        apart = apart[np.isfinite(apart).all(axis=1)]
        rms = 1e3 * np.sqrt(np.mean(apart**2, axis=0))
        said.append(
            f"sensor and calibrated rod differ by {rms[0]:.0f} mN in x and {rms[1]:.0f} mN in y (RMS over {len(apart)} "
            "frames of these recordings; the figure that counts is that of other sessions: `tipforce evaluate rod`)"
        )
    return tuple(said)
