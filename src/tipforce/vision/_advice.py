"""The fact that would help most where no catheter is found: each is tried on the same images.

Objects that could be the catheter are numbered. A fact helps if the detection, with that fact stated, finds the
catheter in most of the images: so the advice can be followed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, NoCatheterError
from ..geometry import arc_length
from ..types import Box, Catheter, FloatArray, Image, SessionInfo, ViewInfo
from ._auto_calibrate import auto_calibrate, base_box, side_of
from ._by_locator import detector_log_odds, session_prompts
from ._detector import ShapeDetector
from ._session_size import with_view
from ._settings import BaseSide, VisionSettings
from .locator import Prompts, locate, object_prompts, probability

POINTS = 64
MAX_ASKED_FRAMES = 3
"""Objects are looked for in this number of images."""
MAX_CANDIDATES = 4
MIN_VOTE_SHARE = 0.1
"""An object whose lines have a smaller share of the probability of the first one's is left out."""
MIN_APART_SHARE = 0.03
"""Bases that are nearer to each other, in shares of the image's longer side, are one."""
MIN_PROBABILITY_SHARE = 0.05
"""So is one with a smaller share when its line is read again in all of the images."""
MAX_TRIED_OBJECTS = 2
"""The whole detection is tried with facts about this number of objects."""
MIN_FOUND_SHARE = 0.5
"""A fact helps if the catheter is then found in this share of the images."""
ANNOTATED_FRAMES = 8
ANY_LENGTH_M = 0.05
"""Length of the catheter with which a size is tried where neither length nor scale is stated."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """An object that could be the catheter.

    Attributes:
        points: (n, 2) px, its line in `Advice.image`, base to tip.
        diameter_px: its diameter.
        probability: probability that the line is the catheter if it begins at this base; mean over the images.
        region: box from its base on, across the shaft, px.
        side: border that it comes from, by its direction at the base.
    """

    points: FloatArray
    diameter_px: float
    probability: float
    region: Box
    side: BaseSide

    @property
    def length_px(self) -> float:
        """Length of its line."""
        return float(arc_length(self.points)[-1])

    def is_on(self, points: FloatArray) -> bool:
        """Whether half of its line is within a diameter of the line ``points`` (n, 2) px."""
        apart = np.linalg.norm(self.points[:, None] - points, axis=2).min(axis=1)
        return float(np.median(apart)) < self.diameter_px


@dataclass(frozen=True, slots=True, eq=False)
class Advice:
    """The fact that would help most.

    Attributes:
        candidates: the objects that could be the catheter, the most probable first; the first is number 1.
        image: the image in which their lines are.
        facts: sentences that state a fact as lines of bench.toml, one an object; none where no fact helps.
    """

    candidates: tuple[Candidate, ...]
    image: Image
    facts: tuple[str, ...]

    def text(self, path: str = "RECORDING") -> str:
        """Returns the advice as one sentence; ``path``: name of the images in the command."""
        return "; ".join(self.facts) or (
            f"no single fact helps: mark it in {ANNOTATED_FRAMES} frames, "
            f"`tipforce annotate {path} --bench bench.toml --frames {ANNOTATED_FRAMES}`"
        )


def advise(settings: VisionSettings, images: Sequence[Image], info: SessionInfo, *, whole: bool = True) -> Advice:
    """Finds the fact that would help most.

    Args:
        settings: the settings of the user.
        images: images in which no catheter is found; at least one.
        info: their metadata.
        whole: see `auto_calibrate`.

    Raises:
        InputError: the fine-tuned locator of the settings does not exist.
    """
    frames = list(images[:: -(-len(images) // MAX_ASKED_FRAMES)])
    found = likely_objects(settings, frames, info)

    def helps(stated: SessionInfo) -> bool:
        try:
            detector = ShapeDetector(auto_calibrate(settings, images, stated, whole=whole))
        except InputError:
            return False
        return sum(detector.detect(frame).found for frame in frames) >= MIN_FOUND_SHARE * len(frames)

    facts: list[str] = []
    for number, candidate in enumerate(found[:MAX_TRIED_OBJECTS], start=1):
        if facts and candidate.is_on(found[0].points):
            continue  # the same shaft
        u, v = candidate.points[0]
        marked, region = _marked(info, settings.view, candidate)
        sized, size = _sized(info, settings.view, candidate)
        both = _sized(marked, settings.view, candidate)[0]
        for stated, lines in ((marked, region), (sized, size), (both, f"{region}, and {size}")):
            if helps(stated):
                facts.append(f"if the catheter is object {number}, which begins at ({u:.0f}, {v:.0f}), state {lines}")
                break
    return Advice(tuple(found), frames[0], tuple(facts))


def with_advice(
    error: InputError, settings: VisionSettings, images: Sequence[Image], info: SessionInfo, *, whole: bool = True
) -> str:
    """Returns the message of ``error`` of `auto_calibrate`, with the fact that would help most; see `advise`."""
    if not isinstance(error, NoCatheterError):
        return str(error)
    return f"{error.reason}: {advise(settings, images, info, whole=whole).text()}"


def _marked(info: SessionInfo, view: str, candidate: Candidate) -> tuple[SessionInfo, str]:
    """Returns ``info`` with the base of ``candidate`` marked, and the lines of bench.toml that state it."""
    own = info.view(view)
    marked = replace(own, base_region=candidate.region)
    lines = f"views.{view}.base_region = {list(candidate.region)}"
    if own.base_side not in (None, candidate.side) and candidate.side != "auto":
        marked = replace(marked, base_side=candidate.side)
        lines += f' and views.{view}.base_side = "{candidate.side}"'
    return _with(info, view, marked), lines


def _with(info: SessionInfo, view: str, stated: ViewInfo, catheter: Catheter | None = None) -> SessionInfo:
    return replace(info, views={**info.views, view: stated}, catheter=catheter or info.catheter)


def _sized(info: SessionInfo, view: str, candidate: Candidate) -> tuple[SessionInfo, str]:
    """Returns ``info`` with the size of ``candidate``, and the lines of bench.toml that state it."""
    own, catheter = info.view(view), info.catheter
    length_px, diameter_px = candidate.length_px, candidate.diameter_px
    facts: dict[str, float] = {}
    flexible_m, rigid_m, scale = catheter.flexible_length_m, catheter.rigid_length_m or 0.0, own.metres_per_px
    if flexible_m is None and scale is not None:
        flexible_m = facts["catheter.flexible_length_m"] = _rounded(length_px * scale - rigid_m)
    else:
        known = flexible_m is not None
        flexible_m = ANY_LENGTH_M if flexible_m is None else flexible_m
        scale = _rounded((flexible_m + rigid_m) / length_px)
        if known:
            facts[f"views.{view}.metres_per_px"] = scale
    diameter_m = catheter.diameter_m
    if diameter_m is None:
        diameter_m = _rounded(diameter_px * scale)
        if facts:
            facts["catheter.diameter_m"] = diameter_m
    sized = replace(catheter, flexible_length_m=flexible_m, diameter_m=diameter_m)
    lines = " and ".join(f"{name} = {value:g}" for name, value in facts.items()) or (
        f"catheter.flexible_length_m, catheter.diameter_m and views.{view}.metres_per_px, by which it is "
        f"{length_px:.0f} px long and {diameter_px:.1f} px thick"
    )
    return _with(info, view, replace(own, metres_per_px=scale), sized), lines


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def likely_objects(settings: VisionSettings, frames: Sequence[Image], info: SessionInfo) -> list[Candidate]:
    """Returns the objects that could be the catheter, the most probable first.

    Args:
        settings: the settings of the user.
        frames: images of the session, (h, w) or (h, w, 3).
        info: its metadata; its stated base and side do not limit the objects.
    """
    stated = with_view(settings, info)
    prompts, network = session_prompts(stated, info)
    prompts = replace(prompts, region=None, border=None)
    log_odds = detector_log_odds(network, marked=False)
    open_size = replace(prompts, length_px=None, diameter_px=None)
    tried = [open_size] if prompts.length_px is None else [prompts, open_size]
    objects = [one for each in tried for one in object_prompts(frames, each, MAX_CANDIDATES, MIN_VOTE_SHARE, network)]
    found = [_candidate(each, frames, network, log_odds) for each in objects]
    limit = MIN_APART_SHARE * max(frames[0].shape[:2])
    distinct: list[Candidate] = []
    for candidate in sorted(filter(None, found), key=lambda each: -each.probability):
        begins = candidate.points[0]
        apart = all(float(np.linalg.norm(begins - other.points[0])) > limit for other in distinct)
        if apart and candidate.probability >= MIN_PROBABILITY_SHARE * (distinct or [candidate])[0].probability:
            distinct.append(candidate)
    return distinct


def _candidate(prompts: Prompts, frames: Sequence[Image], network: Path | None, log_odds: float) -> Candidate | None:
    """Returns the object with these ``prompts``; None where it has a line in no image."""
    lines = [locate(frame, prompts, POINTS, network=network) for frame in frames]
    kept = [line for line in lines if line is not None]
    if not kept:
        return None
    diameter = float(np.median([line.diameter_px for line in kept]))
    side = side_of(kept[0].heading_rad)
    return Candidate(
        kept[0].points,
        diameter,
        sum(probability(line, log_odds) for line in kept) / len(frames),
        base_box(kept[0].points[0], side, diameter, frames[0].shape[:2]),
        side,
    )
