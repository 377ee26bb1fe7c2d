"""Finding once, on the first frames, what the settings leave open."""

import math
import statistics
from collections.abc import Iterable
from itertools import islice, product

import numpy as np

from ..errors import InputError
from ..types import Image, Status
from ._fine import FineTracer, Trace
from ._settings import BaseSide, Polarity, VisionSettings

__all__ = ["is_settled", "settle"]

_FRAMES = 5
_STOUT_PX = 12.0
_SIDES: tuple[BaseSide, ...] = ("left", "right", "top", "bottom")
_POLARITIES: tuple[Polarity, ...] = ("dark", "light")


def is_settled(settings: VisionSettings) -> bool:
    """True where nothing is left to be found: the same answer for the same image, whatever came before."""
    return (
        settings.polarity != "auto"
        and settings.base_side != "auto"
        and settings.threshold is not None
        and settings.diameter_px is not None
    )


def _noise(image: Image) -> float:
    """Standard deviation of the grey level's noise, from second differences along every eighth row."""
    if image.shape[1] < 3:
        return 0.0
    rows = image[::8].astype(np.float64)
    grey = rows if rows.ndim == 2 else rows @ np.array([0.299, 0.587, 0.114])
    return float(np.median(np.abs(np.diff(grey, n=2, axis=1)))) / (0.6745 * math.sqrt(6.0))


def _convincing(trace: Trace, noise: float) -> bool:
    # while the diameter is open, chance pairs of edges in noise pass for a stubby shaft
    if trace.contrast < 2.0 * noise:
        return False
    return (
        trace.status is Status.VALID and trace.length_px > max(5.0 * trace.diameter_px, 24.0) and trace.confidence > 0.6
    )


def settle(settings: VisionSettings, images: Iterable[Image]) -> VisionSettings:
    """``settings`` with polarity, base side, threshold and diameter fixed on the first few of ``images``.

    Every open combination of side and polarity is traced; the one with the longest, best seen shaft that ends inside
    the picture wins. What is already set stays. Raises InputError where no frame shows a catheter.
    """
    if is_settled(settings):
        return settings
    frames = list(islice(images, _FRAMES))
    if not frames:
        raise InputError("there is no frame to settle the vision settings on; give at least one")
    noise = [_noise(frame) for frame in frames]
    sides = _SIDES if settings.base_side == "auto" else (settings.base_side,)
    polarities = _POLARITIES if settings.polarity == "auto" else (settings.polarity,)
    best: tuple[float, VisionSettings, list[Trace]] | None = None
    reasons: list[str] = []
    for side, polarity in product(sides, polarities):
        tried = settings.model_copy(update={"base_side": side, "polarity": polarity})
        tracer = FineTracer(tried)
        looks = [tracer.look(frame) for frame in frames]
        valid = [trace for (trace, _), n in zip(looks, noise, strict=True) if trace and _convincing(trace, n)]
        reasons += [trace.detail if trace else why for trace, why in looks[:1]]
        # of two shafts that end inside the picture the stouter, clearer one is the catheter, the other a cable
        score = sum(
            trace.score * min(1.0, trace.contrast / 40.0) * min(1.0, trace.diameter_px / _STOUT_PX) for trace in valid
        )
        if valid and (best is None or score > best[0]):
            best = (score, tried, valid)
    if best is None:
        different = list(dict.fromkeys(reason for reason in reasons if reason))
        what = different[0] if len(different) == 1 else f"{len(sides) * len(polarities)} ways of looking tried"
        first = "the first frame" if len(frames) == 1 else f"the first {len(frames)} frames"
        raise InputError(
            f"no catheter was found in {first} ({what}): "
            "set polarity and base_side, or mark the shaft's base with base_region"
        )
    _, found, traces = best
    sign = 1.0 if found.polarity == "light" else -1.0
    level = statistics.median(sign * (trace.level - 0.5 * trace.contrast) for trace in traces)
    update: dict[str, object] = {}
    if found.threshold is None:
        update["threshold"] = round(min(max(level, 0.0), 255.0))
    if found.diameter_px is None:
        update["diameter_px"] = round(statistics.median(trace.diameter_px for trace in traces), 2)
    return found.model_copy(update=update)
