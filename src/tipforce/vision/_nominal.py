"""What the sheet beside the bench says of the catheter's size in the picture, and how settings follow it."""

import math
import statistics
from collections.abc import Sequence

import numpy as np

from ..types import FloatArray, Image, SessionInfo
from ._common_axis import common_axis, turn_end
from ._common_end import common_end, common_look
from ._settings import VisionSettings

__all__ = ["in_session", "learn_length", "learn_look", "on_axis", "with_nominal"]

_WIDER = 1.03
"""Flanks are seen so much further apart than the catheter is thick: blur and the rim's lustre."""
_SHOWN, _GIVE = 0.97, 0.08
"""Share of the nominal length that the picture shows of a catheter that enters at its border, and how sure that is."""
_FRAMES = 3
"""Fewer lengths than these teach nothing."""
_DEVIATION = 0.7
"""Standard deviation of the length in shares of its tolerance."""
_ONE, _MANY, _MOST = 0.01, 0.03, 0.08
"""Least tolerance of a length that was learnt in one session, in many, and the most."""


def _nominal_px(info: SessionInfo, view: str) -> tuple[float, float] | None:
    catheter, scale = info.catheter, info.view(view).metres_per_px
    if scale is None or catheter.diameter_m is None or catheter.flexible_length_m is None:
        return None
    length_m = catheter.flexible_length_m + (catheter.rigid_length_m or 0.0)
    return round(length_m / scale, 2), round(catheter.diameter_m / scale, 3)


def with_nominal(settings: VisionSettings, info: SessionInfo) -> VisionSettings:
    """``settings`` with the size and the base's side that ``info`` states, where they leave these open."""
    view = info.view(settings.view)
    stated = {
        "base_side": view.base_side if settings.base_side == "auto" else None,
        "polarity": view.polarity if settings.polarity == "auto" else None,
        "base_region": view.base_region if settings.base_region is None else None,
        "roi": view.roi if settings.roi is None else None,
    }
    if update := {name: value for name, value in stated.items() if value is not None}:
        settings = settings.model_copy(update=update)
    nominal = _nominal_px(info, settings.view)
    if nominal is None or settings.nominal_px is not None or settings.length_px is not None:
        return settings
    sized: dict[str, object] = {
        "nominal_px": nominal,
        "length_px": round(_SHOWN * nominal[0], 2),
        "length_tolerance": _GIVE,
    }
    if settings.diameter_px is None:
        sized["diameter_px"] = round(_WIDER * nominal[1], 2)
    return settings.model_copy(update=sized)


def in_session(settings: VisionSettings, info: SessionInfo) -> VisionSettings:
    """``settings`` for the catheter and the scale of another session; as they are where its sheet tells neither.

    >>> from tipforce.types import Catheter, ViewInfo
    >>> settled = VisionSettings(length_px=230.0, diameter_px=12.0, nominal_px=(240.0, 11.7))
    >>> nearer = SessionInfo("day 2", Catheter("7F", 2.34e-3, 40e-3, 8e-3), {"camera": ViewInfo(0.1e-3)})
    >>> in_session(settled, nearer).length_px
    460.0
    """
    nominal = _nominal_px(info, settings.view)
    if nominal is None or settings.nominal_px is None or nominal == settings.nominal_px:
        return settings
    update: dict[str, object] = {"nominal_px": nominal, "end_look": None}
    for name, now, then in zip(("length_px", "diameter_px"), nominal, settings.nominal_px, strict=True):
        value = getattr(settings, name)
        if value is not None:
            update[name] = round(value * now / then, 2)
    return settings.model_copy(update=update)


def learn_length(
    settings: VisionSettings, infos: Sequence[SessionInfo], images: Sequence[Image], lines: Sequence[FloatArray | None]
) -> VisionSettings:
    """``settings`` with the length that was seen: the median over the sessions, each by all of its pictures together.

    ``lines``: the centreline of each picture, None where it was not seen. A session's length is its own and well
    known; several sessions differ by how far the catheter stands out of its sheath.
    """
    sessions: dict[str, list[int]] = {}
    for k, (info, line) in enumerate(zip(infos, lines, strict=True)):
        if line is not None:
            sessions.setdefault(info.name, []).append(k)
    if sum(map(len, sessions.values())) < _FRAMES:
        return settings
    ratios: list[float] = []
    spreads: list[float] = []
    for members in sessions.values():
        own = in_session(settings, infos[members[0]])
        if own.length_px is None or own.diameter_px is None:
            return settings
        found = common_end(
            [images[k] for k in members],
            [line for k in members if (line := lines[k]) is not None],
            0.5 * own.diameter_px,
            own.length_px,
            _DEVIATION * own.length_tolerance * own.length_px,
        )
        if found is not None:
            ratios.append(found[0] / own.length_px)
            spreads.append(float(np.median(np.abs(found[1] - found[0]))) / own.length_px)
    if settings.length_px is None or not ratios:
        return settings
    middle = statistics.median(ratios)
    apart = statistics.median(abs(ratio - middle) for ratio in ratios)
    spread = 3.0 * 1.4826 * math.hypot(apart, statistics.median(spreads))
    least = _ONE if len(sessions) == 1 else _MANY
    return settings.model_copy(
        update={
            "length_px": round(middle * settings.length_px, 2),
            "length_tolerance": round(min(max(spread, least), _MOST), 4),
        }
    )


def learn_look(settings: VisionSettings, images: Sequence[Image], lines: Sequence[FloatArray | None]) -> VisionSettings:
    """``settings`` with how the catheter's end looks in the pictures of one session; its length must be known."""
    seen = [(image, line) for image, line in zip(images, lines, strict=True) if line is not None]
    if settings.length_px is None or settings.diameter_px is None or len(seen) < _FRAMES:
        return settings
    look = common_look([i for i, _ in seen], [line for _, line in seen], 0.5 * settings.diameter_px, settings.length_px)
    return settings.model_copy(update={"end_look": look})


def on_axis(
    settings: VisionSettings, images: Sequence[Image], lines: Sequence[FloatArray | None]
) -> list[FloatArray | None]:
    """The ``lines`` of one session's pictures, turned at the end by what all of them lie beside the catheter there."""
    seen = [(image, line) for image, line in zip(images, lines, strict=True) if line is not None]
    if settings.length_px is None or settings.diameter_px is None or len(seen) < _FRAMES:
        return list(lines)
    half = 0.5 * settings.diameter_px
    aside = common_axis([i for i, _ in seen], [line for _, line in seen], half, settings.length_px)
    return [None if line is None else turn_end(line, half, settings.length_px, aside) for line in lines]
