"""Finding once, on the first frames, what the settings leave open."""

import math
import statistics
from collections.abc import Iterable, Sequence
from itertools import islice, product

import numpy as np

from ..errors import InputError
from ..types import FloatArray, Image, SessionInfo, Status
from ._fine import FineTracer, Trace
from ._nominal import in_session, learn_length, learn_look, on_axis, with_nominal
from ._settings import BaseSide, Polarity, VisionSettings
from ._sighting import Sighting

__all__ = ["is_settled", "settle"]

_FRAMES = 16
_LOOKS = 3
"""The catheter's end is learnt so many times: where it is known how it looks, it is found more often."""
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


def _threshold(settings: VisionSettings, frames: Sequence[Image], infos: Sequence[SessionInfo]) -> int | None:
    """The grey level half-way from the shaft to what lies beside it, or as little further as loses no frame.

    None where no frame is seen.
    """

    def seen(tried: VisionSettings) -> list[Sighting]:
        return [FineTracer(in_session(tried, c)).see(frame) for frame, c in zip(frames, infos, strict=True)]

    levels = [_levels(frame, sight) for frame, sight in zip(frames, seen(settings), strict=True) if sight.found]
    if not levels:
        return None
    shaft, ground = (statistics.median(values) for values in zip(*levels, strict=True))
    threshold = 0
    for share in (0.5, 0.75, 1.0):
        threshold = round(shaft + share * (ground - shaft))
        if sum(sight.found for sight in seen(settings.model_copy(update={"threshold": threshold}))) >= len(levels):
            break
    return threshold


def _levels(image: Image, sighting: Sighting) -> tuple[float, float]:
    """Grey levels of the shaft and of what lies beside it.

    Its axis alone would not do: a highlight runs along it, as bright as the shadow beside it.
    """
    assert sighting.centreline is not None
    points, diameter = sighting.centreline.points, sighting.diameter_px
    tangent = np.gradient(points, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]

    def median(offsets: FloatArray) -> float:
        """Grey level of the pixels at ``offsets`` across the shaft, in diameters."""
        at = np.rint(points[:, None] + offsets[:, None] * diameter * normal[:, None]).astype(np.int64).reshape(-1, 2)
        inside = ((at >= 0) & (at < (image.shape[1], image.shape[0]))).all(axis=1)
        pixels = image[at[inside, 1], at[inside, 0]].astype(np.float64)
        grey = pixels if pixels.ndim == 1 else pixels @ np.array([0.299, 0.587, 0.114])
        return float(np.median(grey))

    return median(np.linspace(-0.4, 0.4, 9)), median(np.array([-1.3, -1.1, -0.9, 0.9, 1.1, 1.3]))


def _best_way(
    settings: VisionSettings, frames: Sequence[Image], infos: Sequence[SessionInfo], reasons: list[str]
) -> tuple[VisionSettings, list[Trace | None]] | None:
    """The side and polarity with the best shafts, and what is convincing of each frame's; ``reasons`` if none is."""
    noise = [_noise(frame) for frame in frames]
    sides = _SIDES if settings.base_side == "auto" else (settings.base_side,)
    polarities = _POLARITIES if settings.polarity == "auto" else (settings.polarity,)
    best: tuple[float, VisionSettings, list[Trace | None]] | None = None
    for side, polarity in product(sides, polarities):
        tried = settings.model_copy(update={"base_side": side, "polarity": polarity})
        looks = [FineTracer(in_session(tried, c)).look(frame) for frame, c in zip(frames, infos, strict=True)]
        traces = [
            trace if trace and _convincing(trace, n) else None for (trace, _), n in zip(looks, noise, strict=True)
        ]
        reasons += [trace.detail if trace else why for trace, why in looks[:1]]
        # of two shafts that end inside the picture the stouter, clearer one is the catheter, the other a cable
        score = sum(
            trace.score * min(1.0, trace.contrast / 40.0) * min(1.0, trace.diameter_px / _STOUT_PX)
            for trace in traces
            if trace
        )
        if score > 0.0 and (best is None or score > best[0]):
            best = (score, tried, traces)
    return best and best[1:]


def _lines(
    settings: VisionSettings, frames: Sequence[Image], infos: Sequence[SessionInfo], traces: Sequence[Trace | None]
) -> list[FloatArray | None]:
    """The centreline in each frame whose trace convinced."""
    seen = [
        FineTracer(in_session(settings, c)).see(frame).centreline if trace else None
        for frame, c, trace in zip(frames, infos, traces, strict=True)
    ]
    return [line.points if line else None for line in seen]


def settle(
    settings: VisionSettings, images: Iterable[Image], infos: SessionInfo | Sequence[SessionInfo] | None = None
) -> VisionSettings:
    """``settings`` with polarity, base side, threshold and diameter fixed on the first 16 of ``images``.

    Every open combination of side and polarity is traced; the one with the longest, best seen shaft that ends inside
    the picture wins. What is already set stays. ``infos``: the session's, or one for each image; where they tell
    the catheter's size and the scale, only a shaft of such a size counts, and its length is learnt too, and of one
    session also how its end looks. That goes best with images from all over a session, for what lies beneath the end
    must change. Raises InputError where no frame shows a catheter.
    """
    if is_settled(settings) and (infos is None or settings.length_px is not None):
        return settings
    frames = list(islice(images, _FRAMES))
    if not frames:
        raise InputError("there is no frame to settle the vision settings on; give at least one")
    sheets = [infos or SessionInfo()] * len(frames) if infos is None or isinstance(infos, SessionInfo) else infos
    reasons: list[str] = []
    found = None
    sized = with_nominal(settings, sheets[0])
    # a view of a part of the catheter only must not hide what is there
    for start in dict.fromkeys((sized, sized.model_copy(update={"length_px": settings.length_px}))):
        found = found or _best_way(start, frames, sheets[: len(frames)], reasons)
    if found is None:
        different = list(dict.fromkeys(reason for reason in reasons if reason))
        what = different[0] if len(different) == 1 else f"{len(reasons)} ways of looking tried"
        first = "the first frame" if len(frames) == 1 else f"the first {len(frames)} frames"
        raise InputError(
            f"no catheter was found in {first} ({what}): "
            "set polarity and base_side, or mark the shaft's base with base_region"
        )
    chosen, traces = found
    guess = chosen
    sheets = list(sheets[: len(frames)])
    if settings.length_px is None and chosen.length_px is not None:
        chosen = learn_length(guess, sheets, frames, _lines(guess, frames, sheets, traces))
        if isinstance(infos, SessionInfo) and chosen is not guess:
            for _ in range(_LOOKS):
                lines = on_axis(chosen, frames, _lines(chosen, frames, sheets, traces))
                chosen = learn_look(learn_length(guess, sheets, frames, lines), frames, lines)
    if chosen.threshold is None:
        # a length or a look that was learnt wrongly refuses every frame: rather without
        for tried in dict.fromkeys((chosen, chosen.model_copy(update={"end_look": None}), guess)):
            threshold = _threshold(tried, frames, sheets)
            if threshold is not None:
                chosen = tried.model_copy(update={"threshold": threshold})
                break
        else:
            raise InputError(
                f"a shaft was found in the first {len(frames)} frames, but in none of them as far as its end: set "
                "base_side, or mark the shaft's base with base_region"
            )
    if settings.diameter_px is None:
        scales = [in_session(chosen, sheet).nominal_px for sheet in sheets]
        widths = [
            trace.diameter_px * (chosen.nominal_px[1] / scale[1] if chosen.nominal_px and scale else 1.0)
            for trace, scale in zip(traces, scales, strict=True)
            if trace
        ]
        chosen = chosen.model_copy(update={"diameter_px": round(statistics.median(widths), 2)})
    return chosen
