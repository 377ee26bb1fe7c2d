"""The clock map of a run: found from the deflection, checked against the stage, or as a person states it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..errors import InputError
from ..io import ClockMap, Inertia
from ..types import FloatArray, IntArray, SensorInfo, SessionInfo
from ..vision import DetectedShape
from ._beat import add_beat
from ._clock import MAX_STDERR_MS, MIN_EXPLAINED, estimate_clock
from ._deflection import shape_coordinates
from ._find import ForceCorrections
from ._inertia import best_inertia, fit_inertia

OffsetChoice = Literal["auto", "none"] | float
"""Estimated; taken as zero; or stated in milliseconds (positive: the camera's clock is ahead)."""

_APART_MS = 25.0
"""Two maps that differ by less (and by less than five standard errors) are consistent."""
_APART_Z = 5.0
_UNCERTAIN_Z = 3.0
"""Distance in standard errors of both at which an uncertain deflection conflicts with the stage."""
_STAGE_STDERR_MS = 6.0
"""Standard error of the offset from the stage's movement in the force: over 8 simulated sessions it was off by 4 to
15 ms, early by the lag of the stage behind its commands."""
_FAR_MS = 250.0
"""From this offset on, the lag of the stage may be beyond those that are tried when the tare is found."""
_MIN_RATE, _MAX_RATE = 1e-3, 1e3
_IN_PLANE = 1e-3
"""An axis of the sensor with a smaller cosine to the image's plane does not act in it."""
_MAX_TIED_MS = 30.0
"""Largest standard error of a deflection that can show that camera and stage run on one clock."""


@dataclass(frozen=True, slots=True)
class ClockChoice:
    """The stated clock map: the offset at the log's first row, and the rate; None: not stated.

    Raises:
        InputError: ``rate`` is no frame rate over another one.
    """

    offset_ms: OffsetChoice = "auto"
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.rate is not None and not _MIN_RATE < self.rate < _MAX_RATE:
            raise InputError(f"rate={self.rate:g}: expected the true over the stated frame rate, as 0.8 for 24 over 30")


@dataclass(frozen=True, slots=True, eq=False)
class DetectedShapes:
    """Shapes detected in the images of a view.

    Attributes:
        frame_ns: (n,) stamps of the images.
        shapes: n shapes.
        view: name of the view.
        blind: the reason why the catheter is not detected at all, or "".
    """

    frame_ns: IntArray
    shapes: Sequence[DetectedShape] = field(default_factory=tuple[DetectedShape, ...])
    view: str = "camera"
    blind: str = ""


def find_clock(
    detected: DetectedShapes,
    info: SessionInfo,
    stamps: IntArray,
    force: FloatArray,
    facts: ForceCorrections,
    choice: ClockChoice,
    remarks: list[str],
    *,
    stage_shares: bool = False,
    nominal_rate: bool = False,
) -> tuple[ClockMap, Inertia]:
    """Finds the clock map between camera and force log: the stated one, else by the deflection, else by the stage.

    Args:
        detected: the shapes in the images.
        info: metadata of the session.
        stamps: (m,) ns, stamps of the force log.
        force: (m, 3) N, readings in the sensor's frame; NaN where there is no plausible one.
        facts: pose of the sensor, tare and inertia of the force log, and the motion of the stage.
        choice: the stated clock map; its offset is "auto" if the map is to be found.
        remarks: receives sentences for the user, as where two of these maps differ.
        stage_shares: whether camera and stage are known to run on one clock, as where one program recorded both. Then
            the stage's movement in the force gives the offset where the deflection does not.
        nominal_rate: whether the images' stamps come from the frame rate of a file, which may be wrong: then the
            stage's movement gives the offset only where the deflection confirms the rate, or a person states it.

    Returns:
        The clock map, ``how="refused"`` with the reason where it cannot be determined; and the inertia, with the rate
        of the stage's clock where the deflection gave it.
    """
    stated = stated_clock(choice, int(stamps[0]))
    if stated is not None and not detected.shapes:
        return stated, facts.inertia
    if detected.blind:
        clock, inertia = ClockMap(how="refused", detail=detected.blind), facts.inertia
    else:
        clock, inertia = _estimated(detected, info, stamps, force, facts, None if stated else choice.rate)
    if stated is not None:
        if clock.how == "estimated" and _conflicting(clock, stated, stamps):
            remarks.append(_stated_remark(clock, stated, stamps))
        return stated, facts.inertia
    rate = choice.rate or 1.0
    nominal_rate = nominal_rate and choice.rate is None
    clock = _from_stage(clock, inertia, rate, stamps, remarks, stage_shares=stage_shares, nominal_rate=nominal_rate)
    if clock.how == "estimated" and clock.detail:
        remarks.append(clock.detail)
    if clock.how == "estimated" and choice.rate is None and clock.rate != 1.0:
        remarks.append(_rate_remark(clock, detected.frame_ns))
    if clock.how == "estimated" and inertia.axes and inertia.rate == rate:
        stage = ClockMap(inertia.lag_ns, "stage", _STAGE_STDERR_MS, rate=rate, reference_ns=inertia.reference_ns)
        if _conflicting(clock, stage, stamps):
            remarks.append(_stage_remark(clock, stage, stamps))
    return clock, inertia


def _stated_remark(found: ClockMap, stated: ClockMap, stamps: IntArray) -> str:
    """Returns the sentence for a stated map that differs from that of the deflection, ``found``."""
    return (
        f"the stated clock map, {_text(stated, stamps)}, conflicts with the deflection, which gives "
        f"{_text(found, stamps)}: the stated one is used; leave it out to use the other"
    )


def _stage_remark(found: ClockMap, stage: ClockMap, stamps: IntArray) -> str:
    """Returns the sentence for a map by the stage that differs from that of the deflection, ``found``."""
    return (
        f"the deflection gives a clock map of {_text(found, stamps)}, the stage's movement in the force "
        f"{_text(stage, stamps)}: the stage's log does not run on the camera's clock, or the images are late; "
        "the deflection is used"
    )


def stated_clock(choice: ClockChoice, first_ns: int) -> ClockMap | None:
    """Returns the map that a person states; None for "auto".

    Args:
        choice: offset and rate.
        first_ns: stamp of the log's first row, at which the offset holds.
    """
    if choice.offset_ms == "auto":
        return None
    if choice.offset_ms == "none":
        return ClockMap() if choice.rate is None else ClockMap(0, "stated", rate=choice.rate, reference_ns=first_ns)
    return ClockMap(round(choice.offset_ms * 1e6), "stated", rate=choice.rate or 1.0, reference_ns=first_ns)


def _estimated(
    detected: DetectedShapes,
    info: SessionInfo,
    stamps: IntArray,
    force: FloatArray,
    facts: ForceCorrections,
    rate: float | None,
) -> tuple[ClockMap, Inertia]:
    """Finds the map by the deflection, and the inertia that goes with it; see `find_clock` for the arguments.

    Where the clocks of camera and log differ, the stage may run on either of them. Then the inertia is fitted for both
    cases, and with the better one the map is found again.
    """
    flexible, rigid = info.catheter.flexible_length_m, info.catheter.rigid_length_m
    share = flexible / (flexible + rigid) if flexible and rigid else 1.0
    scale = info.view(detected.view).metres_per_px
    length = (flexible + (rigid or 0.0)) / scale if flexible and scale else None
    shape = shape_coordinates(detected.shapes, flexible_share=share, length_px=length)
    matrix = (facts.sensor or SensorInfo()).matrix
    missing = np.isnan(force).all(axis=0)
    unread = missing & (np.abs(matrix[:2]).max(axis=0) > _IN_PLANE)
    if unread.any():
        names = " and ".join(name for name, lacks in zip(("Fx", "Fy", "Fz"), unread, strict=True) if lacks)
        return ClockMap(
            how="refused",
            detail=f"the force log has no {names}, and the deflection depends on both components in the image's plane",
        ), facts.inertia

    def clock_with(inertia: Inertia) -> ClockMap:
        """Returns the map by the deflection, with this inertia subtracted from the force."""
        tared = force - facts.tare.force_n - replace(facts, inertia=inertia).carried(stamps)
        tared[:, missing] = 0.0
        stage = bool(inertia.axes)
        return estimate_clock(
            detected.frame_ns,
            shape,
            stamps,
            tared @ matrix.T,
            rate=rate,
            inertial=inertia.how != "estimated" and bool(info.sensor.moving_mass_kg or facts.stage.names),
            removed=inertia.how == "estimated",
            shared_ns=inertia.lag_ns if stage and inertia.rate == (rate or 1.0) == 1.0 else None,
        )

    clock = clock_with(facts.inertia)
    clocks_differ = clock.rate != 1.0 or abs(clock.offset_ms) > _FAR_MS
    if not facts.stage.names or not facts.tare.stretches_s or not clocks_differ:
        return clock, facts.inertia
    # the stage may run on the camera's clock, which is now known to be another one than the log's
    stretch = facts.tare.stretches_s[0]
    middle = np.array([int(stamps[0]) + round(0.5e9 * sum(stretch))])
    lag_ns = int((clock.camera_ns(middle) - middle)[0])
    possible = [facts.inertia] if facts.inertia.how == "estimated" else []
    for stage_rate in dict.fromkeys((clock.rate, 1.0)):
        tare, inertia = fit_inertia(stamps, force, facts.stage, stretch, rate=stage_rate, lag_ns=lag_ns)
        _, inertia = add_beat(stamps, force, facts.stage, tare, inertia)
        possible += [inertia] if inertia.how == "estimated" else []
    if not possible:
        return clock, facts.inertia
    # at a wrong lag the stage's log leaves a part that seems to repeat with the beat
    by_stage = [each for each in possible if each.axes and not each.beat_hz]
    inertia = best_inertia(stamps, force, facts.stage, by_stage or possible)
    if inertia is facts.inertia:
        return clock, inertia
    return clock_with(inertia), inertia


def _from_stage(
    found: ClockMap,
    inertia: Inertia,
    rate: float,
    stamps: IntArray,
    remarks: list[str],
    *,
    stage_shares: bool,
    nominal_rate: bool,
) -> ClockMap:
    """Finds the map by the stage's movement in the force, where the deflection alone is not enough.

    Three conditions must hold. The stage runs on the camera's clock: this is known, or a less certain deflection shows
    it. The force shows its movement at the stated rate. The deflection gives no other map: one that differs, or one
    that the force explains, but by no line, shows that the images' stamps are not of the stage's clock.

    Args:
        found: the map by the deflection; it is returned unless it was refused.
        inertia: inertia with the lag of the stage's clock.
        rate: stated rate of the camera's clock against the log's, else 1.
        stamps: (m,) stamps of the force log.
        remarks: receives a sentence on the source of the map.
        stage_shares: see `find_clock`.
        nominal_rate: see `find_clock`; a deflection of which the force explains too little does not confirm the rate.
    """
    if found.how != "refused":
        return found
    close = abs(found.offset_ms - 1e-6 * inertia.lag_ns) < 2.0 * (found.stderr_ms + _STAGE_STDERR_MS)
    confirmed = MAX_STDERR_MS < found.stderr_ms < _MAX_TIED_MS and found.rate == 1.0 and close
    if not inertia.axes or inertia.rate != rate or not (confirmed or stage_shares):
        return ClockMap(how="refused", explained=found.explained, detail=found.detail)
    stage = ClockMap(inertia.lag_ns, "stage", _STAGE_STDERR_MS, rate=rate, reference_ns=inertia.reference_ns)
    if not confirmed and _apart_ms(found, stage, stamps) > _UNCERTAIN_Z * (found.stderr_ms + _STAGE_STDERR_MS):
        detail = f"{found.detail}; the stage's movement in the force gives {_text(stage, stamps)}, a conflict"
        return ClockMap(how="refused", explained=found.explained, detail=detail)
    if math.isnan(found.stderr_ms) and found.explained >= MIN_EXPLAINED:
        return ClockMap(how="refused", explained=found.explained, detail=found.detail)
    if math.isnan(found.stderr_ms) and nominal_rate:
        detail = (
            f"{found.detail}; the stage's movement in the force gives {_text(stage, stamps)}, but nothing shows that "
            "the frame rate of the images is right: state rate=1 if it is"
        )
        return ClockMap(how="refused", explained=found.explained, detail=detail)
    why = (
        f"the deflection, {found.offset_ms:+.1f} +- {found.stderr_ms:.1f} ms, agrees with it but is less certain"
        if confirmed
        else f"the deflection does not show it: {found.detail}"
    )
    remarks.append(
        f"the clock offset, {1e-6 * inertia.lag_ns:+.1f} ms, is taken from the stage's movement in the force, good to "
        f"{_STAGE_STDERR_MS:g} ms: {why}"
    )
    return replace(stage, explained=found.explained, detail=why)


def _apart_ms(found: ClockMap, other: ClockMap, stamps: IntArray) -> float:
    """Returns the largest difference of two maps at the log's first and last row."""
    ends = stamps[[0, -1]]
    return float(np.abs(found.camera_ns(ends) - other.camera_ns(ends)).max()) * 1e-6


def _conflicting(found: ClockMap, other: ClockMap, stamps: IntArray) -> bool:
    half_ms = 0.5e-6 * float(stamps[-1] - stamps[0])
    return _apart_ms(found, other, stamps) > max(_APART_MS, _APART_Z * (found.stderr_ms + found.rate_stderr * half_ms))


def _text(clock: ClockMap, stamps: IntArray) -> str:
    """Returns the map in the words in which it is stated: the offset at the log's first row, and the rate."""
    first = stamps[:1]
    offset_ms = 1e-6 * float((clock.camera_ns(first) - first)[0])
    return f"{offset_ms:+.1f} ms at a rate of {clock.rate:.6g}"


def _rate_remark(found: ClockMap, frame_ns: IntArray) -> str:
    stamped = 1e9 / max(float(np.median(np.diff(frame_ns))), 1.0)
    return (
        f"the camera's clock and the force log's differ in rate: found {found.rate:.6g} +- {found.rate_stderr:.1g}, "
        f"nominal 1. Either {stamped * found.rate:.4g} images a second were taken where the stamps say {stamped:.4g}, "
        f"or the log's clock is wrong by {100.0 * abs(1.0 / found.rate - 1.0):.2g} %; the labels use the rate found, "
        "the images keep their stamps. Where the frame rate of a video is wrong, all speeds are: mend it in the video, "
        f"for `estimate` too: ffmpeg -itsscale {1.0 / found.rate:.6g} -i VIDEO -c copy TIMED.mp4"
    )
