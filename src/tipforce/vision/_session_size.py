"""The catheter's size in the image: from the session metadata, learnt from images, and scaled to other sessions."""

import math
import statistics
from collections.abc import Sequence

import numpy as np

from ..types import FloatArray, Image, SessionInfo
from ._settings import ResolvedVision, VisionSettings
from ._tip_consensus import axis_offset, build_tip_template, common_tip, shift_tip

FLANK_RATIO = 1.03
"""Ratio of the distance of the detected flanks to the diameter: blur and the lustre of the rim widen it."""
_SHOWN, _GIVE = 0.97, 0.08
"""Share of the nominal length that is visible of a catheter that enters at the border, and its tolerance."""
_FRAMES = 3
"""From fewer images nothing is learnt."""
_DEVIATION = 0.7
"""Standard deviation of the length in shares of its tolerance."""
_ONE, _MANY, _MOST = 0.01, 0.03, 0.08
"""Least tolerance of a length that was learnt in one session, in many, and the largest."""


def stated_size_px(info: SessionInfo, view: str) -> tuple[float | None, float | None]:
    """Returns the stated length and diameter of the catheter in the image; None where one or the scale is open."""
    catheter, scale = info.catheter, info.view(view).metres_per_px
    if scale is None:
        return None, None
    flexible_m = catheter.flexible_length_m
    return (
        None if flexible_m is None else round((flexible_m + (catheter.rigid_length_m or 0.0)) / scale, 2),
        None if catheter.diameter_m is None else round(catheter.diameter_m / scale, 3),
    )


def nominal_px(info: SessionInfo, view: str) -> tuple[float, float] | None:
    """Returns the stated length and diameter of the catheter in the image; None where these or the scale are open."""
    length_px, diameter_px = stated_size_px(info, view)
    return None if length_px is None or diameter_px is None else (length_px, diameter_px)


def with_view(settings: VisionSettings, info: SessionInfo) -> VisionSettings:
    """Returns ``settings`` with the session metadata of the view, where these are open."""
    view = info.view(settings.view)
    stated = {
        "base_side": view.base_side if settings.base_side == "auto" else None,
        "polarity": view.polarity if settings.polarity == "auto" else None,
        "base_region": view.base_region if settings.base_region is None else None,
        "roi": view.roi if settings.roi is None else None,
        "detector": view.detector if settings.detector is None else None,
    }
    update = {name: value for name, value in stated.items() if value is not None}
    return settings.model_copy(update=update) if update else settings


def with_nominal(vision: ResolvedVision, info: SessionInfo) -> ResolvedVision:
    """Returns ``vision`` with the nominal length and diameter of the catheter in the image, where these are open.

    One of them counts where the metadata state only that one.
    """
    if vision.length_px is not None:
        return vision
    catheter, scale = info.catheter, info.view(vision.view).metres_per_px
    update: dict[str, object] = {"nominal_px": nominal_px(info, vision.view)}
    if scale is not None and catheter.flexible_length_m is not None:
        length_px = (catheter.flexible_length_m + (catheter.rigid_length_m or 0.0)) / scale
        # a base that is marked is in view
        update["length_px"] = round((_SHOWN if vision.base_region is None else 1.0) * length_px, 2)
        update["length_tolerance"] = _GIVE
    if scale is not None and catheter.diameter_m is not None and vision.diameter_px is None:
        update["diameter_px"] = round(FLANK_RATIO * catheter.diameter_m / scale, 2)
    return vision.model_copy(update=update)


def for_session(vision: ResolvedVision, info: SessionInfo) -> ResolvedVision:
    """Returns ``vision`` for another session: with its metadata of the view, the catheter and the scale.

    Where these are unknown it stays as it is. The locator's constants of one session do not hold in another.

    >>> from tipforce.types import Catheter, ViewInfo
    >>> settings = VisionSettings(polarity="dark", base_side="left", length_px=230.0, diameter_px=12.0)
    >>> resolved = ResolvedVision.stated(settings).model_copy(update={"nominal_px": (240.0, 11.7)})
    >>> nearer = SessionInfo("day 2", Catheter("7F", 2.34e-3, 40e-3, 8e-3), {"camera": ViewInfo(0.1e-3)})
    >>> for_session(resolved, nearer).length_px
    460.0
    """
    if vision.locator is not None and vision.locator.session != info.name:
        vision = vision.model_copy(update={"locator": None})
    vision = _with_stated_view(vision, info)
    nominal = nominal_px(info, vision.view)
    if nominal is None or vision.nominal_px is None or nominal == vision.nominal_px:
        return vision
    update: dict[str, object] = {"nominal_px": nominal, "tip_template": None, "locator": None}
    for name, now, then in zip(("length_px", "diameter_px"), nominal, vision.nominal_px, strict=True):
        value = getattr(vision, name)
        if value is not None:
            update[name] = round(value * now / then, 2)
    return vision.model_copy(update=update)


def _with_stated_view(vision: ResolvedVision, info: SessionInfo) -> ResolvedVision:
    """Returns ``vision`` with the session metadata of the view, in place of the findings in another session."""
    stated = with_view(vision.settings, info)
    update: dict[str, object] = {}
    if stated.base_side not in ("auto", vision.base_side):
        update |= {"base_side": stated.base_side, "base_region": None}
    if stated.polarity not in ("auto", vision.polarity):
        update |= {"polarity": stated.polarity, "threshold": vision.settings.threshold, "tip_template": None}
    if stated.base_region is not None:
        update["base_region"] = stated.base_region
    if stated.roi is not None:
        update["roi"] = stated.roi
    return vision.model_copy(update=update) if update else vision


def learn_length(
    vision: ResolvedVision, infos: Sequence[SessionInfo], images: Sequence[Image], lines: Sequence[FloatArray | None]
) -> ResolvedVision:
    """Returns ``vision`` with the length in the images: the median over the sessions, each from all of its images.

    ``lines``: the centreline of each image, None where it was not detected. The length of one session is well known;
    sessions differ in the length of catheter outside of the sheath.
    """
    sessions: dict[str, list[int]] = {}
    for k, (info, line) in enumerate(zip(infos, lines, strict=True)):
        if line is not None:
            sessions.setdefault(info.name, []).append(k)
    if sum(map(len, sessions.values())) < _FRAMES:
        return vision
    ratios: list[float] = []
    spreads: list[float] = []
    for members in sessions.values():
        own = for_session(vision, infos[members[0]])
        if own.length_px is None or own.diameter_px is None:
            return vision
        found = common_tip(
            [images[k] for k in members],
            [line for k in members if (line := lines[k]) is not None],
            0.5 * own.diameter_px,
            own.length_px,
            _DEVIATION * own.length_tolerance * own.length_px,
        )
        if found is not None:
            ratios.append(found[0] / own.length_px)
            spreads.append(float(np.median(np.abs(found[1] - found[0]))) / own.length_px)
    if vision.length_px is None or not ratios:
        return vision
    middle = statistics.median(ratios)
    apart = statistics.median(abs(ratio - middle) for ratio in ratios)
    spread = 3.0 * 1.4826 * math.hypot(apart, statistics.median(spreads))
    least = _ONE if len(sessions) == 1 else _MANY
    return vision.model_copy(
        update={
            "length_px": round(middle * vision.length_px, 2),
            "length_tolerance": round(min(max(spread, least), _MOST), 4),
        }
    )


def learn_tip_template(
    vision: ResolvedVision, images: Sequence[Image], lines: Sequence[FloatArray | None]
) -> ResolvedVision:
    """Returns ``vision`` with the tip template of the images of one session; the length must be known."""
    seen = [(image, line) for image, line in zip(images, lines, strict=True) if line is not None]
    if vision.length_px is None or vision.diameter_px is None or len(seen) < _FRAMES:
        return vision
    template = build_tip_template(
        [i for i, _ in seen], [line for _, line in seen], 0.5 * vision.diameter_px, vision.length_px
    )
    return vision.model_copy(update={"tip_template": template})


def on_axis(
    vision: ResolvedVision, images: Sequence[Image], lines: Sequence[FloatArray | None]
) -> list[FloatArray | None]:
    """Returns the ``lines`` of one session, shifted at the tip by their common offset from the catheter's axis."""
    seen = [(image, line) for image, line in zip(images, lines, strict=True) if line is not None]
    if vision.length_px is None or vision.diameter_px is None or len(seen) < _FRAMES:
        return list(lines)
    half = 0.5 * vision.diameter_px
    offset = axis_offset([i for i, _ in seen], [line for _, line in seen], half, vision.length_px)
    return [None if line is None else shift_tip(line, half, vision.length_px, offset) for line in lines]
