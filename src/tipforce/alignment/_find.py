"""What a run tells of its own force log: tare, inertia and clock offset, found or as a person states them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..io import ClockOffset, Inertia, Tare
from ..plausibility import MAX_GAP_S, ForcePlausibility
from ..types import BoolArray, FloatArray, IntArray, SensorInfo, SessionInfo
from ..vision import DetectedShape
from ._inertia import StageMotion, carried_n, fit_inertia
from ._tare import find_tare, stated_tare
from ._timing import estimate_offset, shape_coordinates

__all__ = ["ForceCorrections", "OffsetChoice", "TareChoice", "find_offset", "find_tare_and_inertia"]

TareChoice = Literal["auto", "none"] | tuple[float, float]
"""Found; nothing subtracted; or from and to, in seconds of the force log."""
OffsetChoice = Literal["auto", "none"] | float
"""Estimated; taken as zero; or stated in milliseconds (positive: the camera's clock is ahead)."""

_LOOK_S = 0.3
"""Largest clock offset that is looked for."""
_UNCERTAIN_MS = 3.0
"""From this standard error on the stage's movement, where it shows, tells the offset better than the deflection."""

_APART_MS = 25.0
"""The stage's movement is good to some milliseconds: a deflection that says otherwise by more fits another beat."""


@dataclass(frozen=True, slots=True, eq=False)
class ForceCorrections:
    """How the force log of a run is read: everything but its clock. ``sensor``: None where nobody stated its pose."""

    sensor: SensorInfo | None
    tare: Tare
    inertia: Inertia
    stage: StageMotion
    plausibility: ForcePlausibility = field(default_factory=ForcePlausibility)

    def carried(self, stamps_ns: IntArray) -> FloatArray:
        """(n, 3) N, or (3,) zeros: what readings at ``stamps_ns`` show of the mass that the sensor carries."""
        return carried_n(self.stage, self.inertia, stamps_ns)


def find_tare_and_inertia(
    stamps: IntArray, force: FloatArray, stage: StageMotion, choice: TareChoice, remarks: list[str]
) -> tuple[Tare, Inertia]:
    """Tare and inertia of the readings (n, 3); adds to ``remarks`` what a person should know of them."""
    if choice == "none":
        return Tare(), Inertia()
    if not isinstance(choice, str):
        if not stage.names:
            return stated_tare(stamps, force, *choice), Inertia()
        tare, inertia = fit_inertia(stamps, force, stage, choice)
        if inertia.how == "none":
            remarks.append(inertia.detail)
        return tare, inertia
    tare = find_tare(stamps, force)
    if tare.how == "none":
        remarks.append(f"the force is not tared: {tare.detail}")
    elif stage.names:
        return fit_inertia(stamps, force, stage, max(tare.stretches_s, key=lambda stretch: stretch[1] - stretch[0]))
    return tare, Inertia()


def find_offset(
    frame_ns: IntArray,
    shapes: Sequence[DetectedShape],
    info: SessionInfo,
    view: str,
    stamps: IntArray,
    force: FloatArray,
    facts: ForceCorrections,
    choice: OffsetChoice,
    remarks: list[str],
    blind: str = "",
) -> ClockOffset:
    """From the deflection in ``shapes`` (n) of ``view`` at ``frame_ns`` and ``force`` (m, 3) at ``stamps``.

    Where that does not tell it, or with a standard error above 3 ms only, or 25 ms apart from it: from the lag at which
    the stage's movement shows in the force, if it does.
    ``blind``: why no catheter is detected at all, or empty. Adds to ``remarks``.
    """
    if choice == "none":
        return ClockOffset()
    if not isinstance(choice, str):
        return ClockOffset(round(choice * 1e6), "stated")
    offset = ClockOffset(how="refused", detail=blind)
    if not blind:
        offset = _by_sight(frame_ns, shapes, info, view, stamps, force, facts)
    if facts.inertia.how == "estimated" and offset.stderr_ms > _UNCERTAIN_MS:
        offset = ClockOffset(how="refused", detail=f"the deflection tells it to +-{offset.stderr_ms:.1f} ms only")
    apart_ms = abs(offset.offset_ms - 1e-6 * facts.inertia.lag_ns)
    if offset.how == "estimated" and facts.inertia.how == "estimated" and apart_ms > _APART_MS:
        why = f"; {offset.detail}" if offset.detail else ""
        offset = ClockOffset(how="refused", detail=f"the deflection would have {offset.offset_ms:+.1f} ms{why}")
    if offset.how == "refused" and facts.inertia.how == "estimated":
        offset = ClockOffset(facts.inertia.lag_ns, "stage", detail=offset.detail)
        remarks.append(
            f"the clock offset, {offset.offset_ms:+.1f} ms, is taken from the stage's movement, good to some "
            f"milliseconds, for the images do not tell: {offset.detail}"
        )
    elif offset.how == "refused":
        remarks.append(
            f"the clock offset is taken as 0, for it could not be determined: {offset.detail}; see offset_ms"
        )
    elif offset.detail:
        remarks.append(offset.detail)
    return offset


def _by_sight(
    frame_ns: IntArray,
    shapes: Sequence[DetectedShape],
    info: SessionInfo,
    view: str,
    stamps: IntArray,
    force: FloatArray,
    facts: ForceCorrections,
) -> ClockOffset:
    flexible, rigid = info.catheter.flexible_length_m, info.catheter.rigid_length_m
    share = flexible / (flexible + rigid) if flexible and rigid else 1.0
    scale = info.view(view).metres_per_px
    length = (flexible + (rigid or 0.0)) / scale if flexible and scale else None
    matrix = (facts.sensor or SensorInfo()).matrix
    axes = ~np.isnan(force).all(axis=0)
    usable = np.isfinite(force[:, axes]).all(axis=1)
    stamps, force = stamps[usable], force[usable]
    tared = np.nan_to_num(force - facts.tare.force_n - facts.carried(stamps)) @ matrix.T
    shape = shape_coordinates(shapes, flexible_share=share, length_px=length)
    shape[_near_gaps(frame_ns, stamps)] = np.nan
    return estimate_offset(frame_ns, shape, stamps, tared, window_s=_LOOK_S)


def _near_gaps(frame_ns: IntArray, stamps: IntArray) -> BoolArray:
    """(n,) frames that some offset within the window would place in a gap of the readings at ``stamps`` (m,)."""
    at = np.flatnonzero(np.diff(stamps) > round(1e9 * MAX_GAP_S))
    margin = round(1e9 * _LOOK_S)
    near = np.zeros(len(frame_ns), np.bool_)
    for start, end in zip((stamps[at] - margin).tolist(), (stamps[at + 1] + margin).tolist(), strict=True):
        near |= (frame_ns > start) & (frame_ns < end)
    return near
