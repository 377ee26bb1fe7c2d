"""Auto-calibration: finds the vision settings that the user left open, once and on several images.

The locator says which object is the catheter: where its base is, on which side, of which polarity and size. The tracer
then learns the threshold, the length and the template of the tip of that object.
"""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from .._system.rows import evenly_spread
from ..errors import InputError, NoCatheterError
from ..geometry import tangents_and_normals
from ..types import Box, DetectedShape, FloatArray, Image, SessionInfo, Status
from ._by_locator import detector_log_odds, same_line, session_prompts
from ._clamp import INWARD
from ._session_size import (
    for_session,
    learn_length,
    learn_tip_template,
    nominal_px,
    on_axis,
    with_nominal,
    with_view,
)
from ._settings import BaseSide, LocatorPrior, Polarity, ResolvedVision, VisionSettings
from .locator import MIN_FRAMES, Located, SessionConstants, probability, session_constants
from .tracer import Trace, Tracer

MAX_FRAMES = 16
"""Number of images that resolve the open values; more are thinned evenly."""
TEMPLATE_ROUNDS = 3
"""Number of times that the tip template is learnt: with a template the tip is found more often."""
MAX_LOCATED_FRAMES = 8
"""The locator reads this number of the images: each takes it 20 to 50 ms."""
MIN_AGREEING_SHARE = 0.5
"""The tracer and the locator find the same line in this share of the images in which both find one, at least."""
MIN_TRACED_SHARE = 0.25
"""It must find a line in this share of the images."""
MAX_APART_DIAMETERS = 0.01
"""It is asked first if its lines are as near to those of the locator. On 26 sessions of three presets the locator's
lines err by 0.002 to 0.024 diameters, those of the tracer by 0.002 to 0.16, and only the locator says which."""
MIN_SESSION_PROBABILITY = 0.2
"""One line of the session must be right with this probability, where the tracer does not find the same object."""
BOX_LENGTH_DIAMETERS, BOX_HALF_WIDTH_DIAMETERS = 3.0, 1.6
"""Size of the base region that the tracer is given."""


def is_resolved(settings: VisionSettings) -> bool:
    """True where nothing is left to be found."""
    return (
        settings.polarity != "auto"
        and settings.base_side != "auto"
        and settings.threshold is not None
        and settings.diameter_px is not None
    )


def enough_images(frames: Sequence[Image]) -> bool:
    """Whether there are enough ``frames`` of a session to refuse an object in all of them."""
    return len(frames) >= MIN_FRAMES


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
    _, normal = tangents_and_normals(points)

    def median(offsets: FloatArray) -> float:
        """Median grey level of the pixels at ``offsets`` across the shaft, in diameters."""
        at = np.rint(points[:, None] + offsets[:, None] * diameter * normal[:, None]).astype(np.int64).reshape(-1, 2)
        inside = ((at >= 0) & (at < (image.shape[1], image.shape[0]))).all(axis=1)
        pixels = image[at[inside, 1], at[inside, 0]].astype(np.float64)
        grey = pixels if pixels.ndim == 1 else pixels @ np.array([0.299, 0.587, 0.114])
        return float(np.median(grey))

    return median(np.linspace(-0.4, 0.4, 9)), median(np.array([-1.3, -1.1, -0.9, 0.9, 1.1, 1.3]))


def _traces(
    vision: ResolvedVision, frames: Sequence[Image], infos: Sequence[SessionInfo]
) -> tuple[list[Trace | None], list[str]]:
    """Returns each frame's trace if it is convincing, and the reasons why others are not."""
    traces: list[Trace | None] = []
    reasons: list[str] = []
    for frame, info in zip(frames, infos, strict=True):
        trace, reason = Tracer(for_session(vision, info)).best_trace(frame)
        traces.append(trace if trace and _convincing(trace, _noise(frame)) else None)
        # a shaft that was followed to an end is a better reason than an empty border
        reasons.append(trace.detail if trace and trace.detail else reason)
    return traces, sorted(filter(None, reasons), key=lambda reason: "border" in reason)


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
    length_px: float | None = None,
) -> ResolvedVision:  # fmt: skip
    """Finds the settings of the tracer that ``stated`` leaves open.

    Args:
        settings: the settings of the user.
        stated: the same with everything that is known; side and polarity are.
        frames: images.
        each: metadata of each image.
        one: all frames are of one session, so that its tip template can be learnt.
        length_px: length of the catheter in the image, as the locator finds it; None: as the metadata state it.

    Raises:
        InputError: the tracer finds no shaft.
    """
    start = ResolvedVision.stated(stated).model_copy(update={"settings": settings})
    guess = chosen = with_nominal(start, each[0])
    if length_px is not None and settings.length_px is None and chosen.length_px is not None:
        guess = chosen = chosen.model_copy(update={"length_px": round(length_px, 2)})
    traces, reasons = _traces(chosen, frames, each)
    if not any(traces):
        first = "the first frame" if len(frames) == 1 else f"the first {len(frames)} frames"
        raise InputError(
            f"no catheter was found in {first} ({reasons[0] if reasons else 'nothing enters'}): set polarity and "
            "base_side, or " + ("move base_region" if stated.base_region else "mark the shaft's base with base_region")
        )
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
        chosen = chosen.model_copy(update={"diameter_px": round(statistics.median(widths), 1)})
    return chosen


def auto_calibrate(
    settings: VisionSettings, images: Iterable[Image], infos: SessionInfo | Sequence[SessionInfo] | None = None, *,
    whole: bool = True,
) -> ResolvedVision:  # fmt: skip
    """Finds the open values of ``settings`` on 16 of the ``images``: polarity, base side, threshold, diameter.

    Values that are set stay, and are prompts of the locator. Where the size of the catheter and the scale are known,
    the length in the image is learnt too; with one session also the tip template, the base and the constants of the
    locator. That works best with images from all over a session, because the ground beneath the tip must change.

    Args:
        settings: the settings of the user.
        images: (h, w) grey or (h, w, 3) RGB, uint8.
        infos: metadata of the session; or one entry for each image.
        whole: the images are from all over the session. Then an object that stands still in all of them while they
            change is taken for a post. Not so at the beginning, when the catheter waits for the tissue.

    Returns:
        The settings with all values, stated or found.

    Raises:
        NoCatheterError: no frame shows a catheter, the detected object cannot be one, or two objects could be it.
        InputError: the tracer alone finds none, or the fine-tuned locator does not exist.
    """
    if is_resolved(settings) and (infos is None or settings.length_px is not None):
        first = infos if infos is None or isinstance(infos, SessionInfo) else next(iter(infos), None)
        resolved = ResolvedVision.stated(settings if first is None else with_view(settings, first))
        return resolved.model_copy(update={"settings": settings})
    given = list(images)
    if not given:
        raise InputError("there is no frame for the auto-calibration of the vision settings; give at least one")
    one = isinstance(infos, SessionInfo)
    each = [infos or SessionInfo()] * len(given) if infos is None or one else list(infos)
    chosen = evenly_spread(len(given), MAX_FRAMES).tolist()
    frames, each = [given[place] for place in chosen], [each[place] for place in chosen]
    stated = with_view(settings, each[0])
    if settings.method == "tracer" and "auto" not in (stated.polarity, stated.base_side):
        return _with_rejection(_calibrated(settings, stated, frames, each, one))
    if not one:
        return _shared(settings, stated, frames, each)
    return _of_session(settings, stated, frames, each[0], whole=whole)


def _of_session(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], info: SessionInfo, *, whole: bool
) -> ResolvedVision:
    """Returns the settings for one session, with the constants that the locator finds in its images."""
    located = frames[:: -(-len(frames) // MAX_LOCATED_FRAMES)]
    prompts, network = session_prompts(stated, info)
    try:
        constants = session_constants(
            located,
            prompts,
            moves=whole and enough_images(frames),
            network=network,
        )
    except InputError as error:
        several = isinstance(error, NoCatheterError) and error.several
        raise NoCatheterError(str(error), _remedy(stated), several=several) from error
    way = _way(stated, constants, frames[0])
    found = ResolvedVision.stated(way).model_copy(
        update={"settings": settings, "diameter_px": round(constants.diameter_px, 3)}
    )
    agrees, exact, traced = False, False, found
    try:
        traced = _calibrated(settings, way, frames, [info] * len(frames), True, constants.length_px)
        agrees, exact = _compared(Tracer(traced), located, constants)
        found = traced if agrees else found
    except InputError as error:
        if settings.method == "tracer":
            raise error
    if settings.method == "tracer":
        if not agrees and enough_images(frames):
            raise NoCatheterError("the tracer follows another object than the locator finds", _remedy(stated))
        return _with_rejection(traced)
    log_odds = detector_log_odds(network, marked=stated.base_region is not None)
    likely = max((probability(line, log_odds) for line in constants.lines if line is not None), default=0.0)
    if not agrees and likely < min(MIN_SESSION_PROBABILITY, settings.least_probability):
        begins = constants.base_px
        raise NoCatheterError(
            f"the object found, which begins at ({begins[0]:.0f}, {begins[1]:.0f}), is the catheter with a probability "
            f"of {likely:.0%} at most",
            _remedy(stated),
        )
    prior = LocatorPrior(
        session=info.name,
        base_px=(float(round(constants.base_px[0])), float(round(constants.base_px[1]))),
        base_in_view=constants.base_in_view,
        length_px=round(constants.length_px),
        length_std_px=round(max(constants.length_std_px, 0.1), 1),
        diameter_px=round(constants.diameter_px, 1),
        log_odds=round(log_odds, 3),
        xray=prompts.xray,
        tracer=exact,
    )
    return _with_rejection(
        found.model_copy(
            update={
                "locator": prior,
                "nominal_px": nominal_px(info, stated.view),
                "detector": stated.detector,
            }
        )
    )


def _remedy(stated: VisionSettings) -> str:
    """Returns the one statement of the user that helps most."""
    if stated.base_region is not None:
        return "base_region must cross the shaft right behind its base, and roi must exclude similar objects"
    return "mark the shaft's base with base_region"


def _way(stated: VisionSettings, constants: SessionConstants, frame: Image) -> VisionSettings:
    """Returns ``stated`` with the side, the polarity and the base of the object that the locator found."""
    side = stated.base_side if stated.base_side != "auto" else side_of(constants.heading_rad)
    polarity: Polarity = stated.polarity if stated.polarity != "auto" else "dark" if constants.darker else "light"
    box = stated.base_region
    if box is None or (stated.method == "auto" and constants.base_in_view):
        box = base_box(constants.base_px, side, constants.diameter_px, frame.shape[:2])
    return stated.model_copy(update={"base_side": side, "polarity": polarity, "base_region": box})


def side_of(heading_rad: float) -> BaseSide:
    """Returns the side that a shaft with this direction at its base comes from; v points down."""
    sides: tuple[BaseSide, ...] = ("left", "top", "right", "bottom")
    return sides[round(heading_rad / (0.5 * math.pi)) % 4]


def base_box(base_px: FloatArray, side: BaseSide, diameter_px: float, size: tuple[int, int]) -> Box:
    """Returns the base region just beyond ``base_px`` in an image of ``size`` (h, w)."""
    rows, columns = size
    base_px = np.clip(base_px, 0, (columns - 1, rows - 1))
    reach, half = BOX_LENGTH_DIAMETERS * diameter_px, BOX_HALF_WIDTH_DIAMETERS * diameter_px
    low, high = base_px.copy(), base_px.copy()
    for k, step in enumerate(INWARD[side]):
        low[k] += -half if step == 0 else -reach if step < 0 else 0.0
        high[k] += half if step == 0 else reach if step > 0 else 0.0
    u0, v0 = np.ceil(low).astype(int).tolist()
    u1, v1 = (np.ceil(high).astype(int) + 1).tolist()
    return max(u0, 0), max(v0, 0), min(u1, columns), min(v1, rows)


def _compared(tracer: Tracer, frames: Sequence[Image], constants: SessionConstants) -> tuple[bool, bool]:
    """Compares ``tracer`` with the locator in the images in which both find a line.

    Returns:
        Whether it finds the locator's line in most of them, and finds one often; and whether these lines are as exact
        as the locator's.
    """
    both, apart = 0, list[float]()
    for frame, line in zip(frames, constants.lines, strict=True):
        if line is None or (shape := tracer.detect(frame)).centreline is None:
            continue
        both += 1
        if same_line(shape.centreline.points, line.points, constants.diameter_px):
            apart.append(_distance_px(shape.centreline.points, line))
    agrees = both >= max(1.0, MIN_TRACED_SHARE * len(frames)) and len(apart) > MIN_AGREEING_SHARE * both
    return agrees, agrees and statistics.median(apart) <= MAX_APART_DIAMETERS * constants.diameter_px


def _distance_px(points: FloatArray, line: Located) -> float:
    """Returns the root mean square distance of ``points`` (n, 2) from the visible part of a line without its ends."""
    inner = slice(len(line.points) // 16, -len(line.points) // 8)
    _, normal = tangents_and_normals(line.points)
    nearest = points[np.linalg.norm(points[None] - line.points[:, None], axis=2).argmin(axis=1)]
    off = ((nearest - line.points) * normal).sum(axis=1)[inner][line.seen[inner]]
    return float(np.sqrt(np.mean(off**2))) if len(off) else math.inf


def _shared(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], each: Sequence[SessionInfo]
) -> ResolvedVision:
    """Returns the settings of the tracer for images of several sessions, or of unknown ones."""
    ways: Counter[tuple[BaseSide, Polarity]] = Counter()
    reason: InputError | None = None
    for frame, info in zip(frames, each, strict=True):
        own = with_view(settings, info)
        try:
            prompts, network = session_prompts(own, info)
            constants = session_constants([frame], prompts, moves=False, network=network)
        except InputError as error:
            reason = error
            continue
        way = _way(own, constants, frame)
        assert way.base_side != "auto"
        ways[way.base_side, way.polarity] += 1
    if not ways:
        raise NoCatheterError(str(reason), _remedy(stated))
    (side, polarity), _ = ways.most_common(1)[0]
    return _calibrated(
        settings, stated.model_copy(update={"base_side": side, "polarity": polarity}), frames, each, one=False
    )


def _with_rejection(vision: ResolvedVision) -> ResolvedVision:
    """Returns ``vision`` that refuses each frame whose line is not right with the least probability.

    Unchanged where the catheter's size is not stated.
    """
    if vision.nominal_px is None:
        return vision
    return vision.model_copy(update={"least_probability": vision.settings.least_probability})
