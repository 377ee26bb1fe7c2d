"""Auto-calibration: finds the vision settings that the user left open, once and on several images."""

import math
import statistics
from collections.abc import Iterable, Sequence
from itertools import islice, product

import numpy as np

from ..errors import InputError
from ..types import DetectedShape, FloatArray, Image, SessionInfo, Status
from ._by_keypoints import find_by_keypoints
from ._rejection import TWO_OBJECTS, enough_images, rejection_reason, with_rejection
from ._session_size import for_session, learn_length, learn_tip_template, nominal_px, on_axis, with_nominal, with_view
from ._settings import SIDES, BaseSide, Polarity, ResolvedVision, VisionSettings
from .tracer import Trace, Tracer, base_box, find_mouths

_FRAMES = 16
TEMPLATE_ROUNDS = 3
"""Number of times that the tip template is learnt: with a template the tip is found more often."""
_THICK_PX = 12.0
MAX_MOUTHS = 4
"""Number of mouths of a sheath that are tried at a border."""
_CLEARLY = 0.75
"""Where no sheath is seen before the shaft, it must be found in this share of the images."""
_SHARES = (1.0, 1.05, 0.95)
"""The tip is searched about these shares of the stated length: an edge of a metal tip or a ring may be clearer."""
_APART, _RIVAL = 3.0, 0.7
"""Two shafts could both be the catheter if they begin at least this number of diameters apart, and the second is found
in this share of the images of the first."""
_POLARITIES: tuple[Polarity, ...] = ("dark", "light")


class _Ambiguous(InputError):
    """Two objects could be the catheter: a person must say which."""


def is_resolved(settings: VisionSettings) -> bool:
    """True where nothing is left to be found."""
    return (
        settings.polarity != "auto"
        and settings.base_side != "auto"
        and settings.threshold is not None
        and settings.diameter_px is not None
    )


def _noise(image: Image) -> float:
    """Returns the standard deviation of the noise in grey levels, from second differences along every eighth row."""
    if image.shape[1] < 3:
        return 0.0
    rows = image[::8].astype(np.float64)
    grey = rows if rows.ndim == 2 else rows @ np.array([0.299, 0.587, 0.114])
    return float(np.median(np.abs(np.diff(grey, n=2, axis=1)))) / (0.6745 * math.sqrt(6.0))


def _convincing(trace: Trace, noise: float) -> bool:
    # while the diameter is open, random pairs of edges in noise resemble a short shaft
    if trace.contrast < 2.0 * noise:
        return False
    return (
        trace.status is Status.VALID and trace.length_px > max(5.0 * trace.diameter_px, 24.0) and trace.confidence > 0.6
    )


def _threshold(vision: ResolvedVision, frames: Sequence[Image], infos: Sequence[SessionInfo]) -> int | None:
    """Returns the grey level half-way from the shaft to the ground beside it, or further if that would lose frames.

    None where the catheter is detected in no frame.
    """

    def detected(tried: ResolvedVision) -> list[DetectedShape]:
        return [Tracer(for_session(tried, c)).detect(frame) for frame, c in zip(frames, infos, strict=True)]

    levels = [_levels(frame, shape) for frame, shape in zip(frames, detected(vision), strict=True) if shape.found]
    if not levels:
        return None
    shaft, ground = (statistics.median(values) for values in zip(*levels, strict=True))
    threshold = 0
    for share in (0.5, 0.75, 1.0):
        threshold = round(shaft + share * (ground - shaft))
        if sum(shape.found for shape in detected(vision.model_copy(update={"threshold": threshold}))) >= len(levels):
            break
    return threshold


def _levels(image: Image, shape: DetectedShape) -> tuple[float, float]:
    """Returns the grey levels of the shaft and of the ground beside it.

    The axis alone is not enough: a highlight runs along it, as bright as the shadow beside it.
    """
    assert shape.centreline is not None
    points, diameter = shape.centreline.points, shape.diameter_px
    tangent = np.gradient(points, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]

    def median(offsets: FloatArray) -> float:
        """Median grey level of the pixels at ``offsets`` across the shaft, in diameters."""
        at = np.rint(points[:, None] + offsets[:, None] * diameter * normal[:, None]).astype(np.int64).reshape(-1, 2)
        inside = ((at >= 0) & (at < (image.shape[1], image.shape[0]))).all(axis=1)
        pixels = image[at[inside, 1], at[inside, 0]].astype(np.float64)
        grey = pixels if pixels.ndim == 1 else pixels @ np.array([0.299, 0.587, 0.114])
        return float(np.median(grey))

    return median(np.linspace(-0.4, 0.4, 9)), median(np.array([-1.3, -1.1, -0.9, 0.9, 1.1, 1.3]))


def _best_side(
    vision: ResolvedVision, ways: Sequence[tuple[BaseSide, Polarity]], frames: Sequence[Image],
    infos: Sequence[SessionInfo], reasons: list[str],
) -> tuple[ResolvedVision, list[Trace | None]] | None:  # fmt: skip
    """Returns the one of ``ways`` with the best shafts, and each frame's trace if convincing; fills ``reasons``."""
    noise = [_noise(frame) for frame in frames]
    best: tuple[float, ResolvedVision, list[Trace | None]] | None = None
    for side, polarity in ways:
        tried = vision.model_copy(update={"base_side": side, "polarity": polarity})
        found = [Tracer(for_session(tried, c)).best_trace(frame) for frame, c in zip(frames, infos, strict=True)]
        traces = [
            trace if trace and _convincing(trace, n) else None for (trace, _), n in zip(found, noise, strict=True)
        ]
        # a shaft that was followed to an end is a better reason than an empty border
        reasons[:0] = [trace.detail for trace, _ in found[:1] if trace and trace.detail]
        reasons += [why for trace, why in found[:1] if trace is None]
        # of two shafts that end inside the image the thicker, clearer one is the catheter, the other a cable
        score = sum(
            trace.score * min(1.0, trace.contrast / 40.0) * min(1.0, trace.diameter_px / _THICK_PX)
            for trace in traces
            if trace
        )
        if score > 0.0 and (best is None or score > best[0]):
            best = (score, tried, traces)
    return best and best[1:]


def _lines(
    vision: ResolvedVision, frames: Sequence[Image], infos: Sequence[SessionInfo], traces: Sequence[Trace | None]
) -> list[FloatArray | None]:
    """Returns the centreline in each frame whose trace is convincing."""
    lines = [
        Tracer(for_session(vision, c)).detect(frame).centreline if trace else None
        for frame, c, trace in zip(frames, infos, traces, strict=True)
    ]
    return [line.points if line else None for line in lines]


def _calibrated(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], each: Sequence[SessionInfo], one: bool,
    share: float = 1.0,
) -> ResolvedVision:  # fmt: skip
    """Finds the settings that ``stated`` (``settings`` with the session metadata of the view) leave open.

    ``one``: all frames are of one session, so that its tip template can be learnt. ``share``: of the stated length,
    about which it is searched. Raises InputError without a shaft.
    """
    reasons: list[str] = []
    sides = SIDES if stated.base_side == "auto" else (stated.base_side,)
    polarities = _POLARITIES if stated.polarity == "auto" else (stated.polarity,)
    ways = tuple(product(sides, polarities))
    first_way = stated.model_copy(update={"base_side": sides[0], "polarity": polarities[0]})
    start = ResolvedVision.stated(first_way).model_copy(update={"settings": settings})
    sized = with_nominal(start, each[0])
    if share != 1.0 and sized.length_px is not None:
        sized = sized.model_copy(update={"length_px": round(share * sized.length_px, 2)})
    found = _best_side(sized, ways, frames, each, reasons)
    if found is None:
        different = list(dict.fromkeys(reason for reason in reasons if reason))
        first_reason = different[0] if different else "nothing enters"
        if len(ways) > 1:
            first_reason += f"; {len(ways)} combinations of side and polarity tried"
        first = "the first frame" if len(frames) == 1 else f"the first {len(frames)} frames"
        raise InputError(
            f"no catheter was found in {first} ({first_reason}): set polarity and base_side, "
            + ("or move base_region" if stated.base_region else "or mark the shaft's base with base_region")
        )
    chosen, traces = found
    guess = chosen
    if settings.length_px is None and chosen.length_px is not None:
        chosen = learn_length(guess, each, frames, _lines(guess, frames, each, traces))
        if one and chosen is not guess:
            for _ in range(TEMPLATE_ROUNDS):
                lines = on_axis(chosen, frames, _lines(chosen, frames, each, traces))
                chosen = learn_tip_template(learn_length(guess, each, frames, lines), frames, lines)
    if chosen.threshold is None:
        # a wrongly learnt length or template rejects every frame: then go without it
        for tried in dict.fromkeys((chosen, chosen.model_copy(update={"tip_template": None}), guess)):
            threshold = _threshold(tried, frames, each)
            if threshold is not None:
                chosen = tried.model_copy(update={"threshold": threshold})
                break
        else:
            raise InputError(
                f"a shaft was found in the first {len(frames)} frames, but in none of them as far as its end: set "
                "base_side, or mark the shaft's base with base_region"
            )
    if settings.diameter_px is None:
        scales = [for_session(chosen, info).nominal_px for info in each]
        widths = [
            trace.diameter_px * (chosen.nominal_px[1] / scale[1] if chosen.nominal_px and scale else 1.0)
            for trace, scale in zip(traces, scales, strict=True)
            if trace
        ]
        chosen = chosen.model_copy(update={"diameter_px": round(statistics.median(widths), 2)})
    return chosen


def auto_calibrate(
    settings: VisionSettings, images: Iterable[Image], infos: SessionInfo | Sequence[SessionInfo] | None = None, *,
    whole: bool = True,
) -> ResolvedVision:  # fmt: skip
    """Finds the open values of ``settings`` on the first 16 ``images``: polarity, base side, threshold, diameter.

    Every open combination of side and polarity is traced; the one with the longest, clearest shaft that ends inside
    the image wins. Values that are set stay. Where the size of the catheter and the scale are known, only a shaft of
    that size counts, and its length in the image is learnt too; with one session also the tip template. That works
    best with images from all over a session, because the ground beneath the tip must change.

    Args:
        settings: the settings of the user.
        images: (h, w) grey or (h, w, 3) RGB, uint8.
        infos: metadata of the session; or one entry for each image.
        whole: the images are from all over the session. Then a shaft that stands still in all of them while they change
            is taken for a post. Not so at the beginning, when the catheter waits for the tissue.

    Returns:
        The settings with all values, stated or found.

    With three images or more of one session the result is checked: see `rejection_reason`. Where the size is stated, a
    catheter that comes out of a sheath in view is preferred to a shaft that begins at the border. Where no shaft at the
    border is the catheter, it is searched from every position where a thin tube begins. With the method "auto" the
    trained networks then examine the same images: where their probability is high, they continue in images that the
    tracer refuses, and take its place where it found nothing or another object.

    Raises:
        InputError: no frame shows a catheter, the detected object cannot be one, or two objects could be it.
    """
    if is_resolved(settings) and (infos is None or settings.length_px is not None):
        first = infos if infos is None or isinstance(infos, SessionInfo) else next(iter(infos), None)
        resolved = ResolvedVision.stated(settings if first is None else with_view(settings, first))
        return resolved.model_copy(update={"settings": settings})
    frames = list(islice(images, _FRAMES))
    if not frames:
        raise InputError("there is no frame for the auto-calibration of the vision settings; give at least one")
    each = [infos or SessionInfo()] * len(frames) if infos is None or isinstance(infos, SessionInfo) else list(infos)
    each = each[: len(frames)]
    one = isinstance(infos, SessionInfo) and enough_images(frames)
    stated = with_view(settings, each[0])
    traced: ResolvedVision | None = None
    refused: InputError | None = None
    try:
        traced = _traced(settings, stated, frames, each, one=one, alike=isinstance(infos, SessionInfo), whole=whole)
    except InputError as error:
        refused = error
    if one and settings.method == "auto" and not isinstance(refused, _Ambiguous):
        located = find_by_keypoints(settings, stated, frames, each[0], traced, whole=whole)
        if located is not None:
            return located
    if refused is not None:
        raise refused
    assert traced is not None
    return traced


def _traced(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], each: Sequence[SessionInfo], *,
    one: bool, alike: bool, whole: bool,
) -> ResolvedVision:  # fmt: skip
    """Returns the result of the tracer at the border or beyond the mouth of a sheath.

    ``alike``: all frames are of one session; ``one``: and enough for `rejection_reason`. Raises InputError.
    """
    border: ResolvedVision | None = None
    refused: InputError | None = None
    try:
        border = _calibrated(settings, stated, frames, each, alike)
        reason = rejection_reason(border, frames, each[0], whole=whole)[0] if one else ""
        if reason:
            kind = _Ambiguous if reason.startswith(TWO_OBJECTS) else InputError
            refused = kind(f"the object found in the first {len(frames)} frames cannot be the catheter: {reason}")
    except InputError as error:
        refused = error
    searched = one and stated.base_region is None
    mouth = _beyond_mouth(settings, stated, frames, each[0], whole, sheathed=refused is None) if searched else None
    if mouth is not None:
        return with_rejection(mouth)
    if border is None or refused is not None:
        assert refused is not None
        raise refused
    return with_rejection(border) if one else border


def _beyond_mouth(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], info: SessionInfo, whole: bool, *,
    sheathed: bool,
) -> ResolvedVision | None:  # fmt: skip
    """Returns the detection of a shaft that comes out of a sheath, calibrated from its mouth on; None without one.

    The sheath's length in view is unknown, so the stated size is needed. ``sheathed``: only out of a sheath that is
    seen. Raises InputError where it could be one of
    two.
    """
    nominal = nominal_px(info, stated.view)
    if nominal is None or len({frame.shape for frame in frames}) > 1:
        return None
    passed: list[tuple[int, ResolvedVision, FloatArray]] = []
    for side in SIDES if stated.base_side == "auto" else (stated.base_side,):
        mouths = find_mouths(frames, side, nominal[1])
        with_sheath = [mouth for mouth in mouths if mouth.sheath > 0.0][:MAX_MOUTHS]
        for mouth in with_sheath + [mouth for mouth in mouths if mouth.sheath == 0.0][:MAX_MOUTHS]:
            if mouth.sheath == 0.0 and (passed or sheathed):
                break
            if stated.polarity not in ("auto", mouth.polarity):
                continue
            box = base_box(mouth, side, nominal[1], frames[0].shape[:2])
            tried = stated.model_copy(update={"base_side": side, "polarity": mouth.polarity, "base_region": box})
            for share in _SHARES:
                try:
                    found = _calibrated(settings, tried, frames, [info] * len(frames), True, share)
                except InputError:
                    continue
                reason, count = rejection_reason(found, frames, info, strict=True, whole=whole)
                if not reason and (mouth.sheath > 0.0 or count >= _CLEARLY * len(frames)):
                    passed.append((count, found, np.array([box[0] + box[2], box[1] + box[3]]) / 2.0))
                    break
    passed.sort(key=lambda candidate: -candidate[0])
    if len(passed) > 1:
        (most, _, here), (next_most, _, there) = passed[:2]
        if np.linalg.norm(here - there) > _APART * nominal[1] and next_most > _RIVAL * most:
            raise _Ambiguous(
                f"two objects could be the catheter: one begins near ({here[0]:.0f}, {here[1]:.0f}), the other near "
                f"({there[0]:.0f}, {there[1]:.0f}): mark the shaft's base with base_region"
            )
    return passed[0][1] if passed else None
