"""Inspection of detections by people: one image in detail, or many at a glance."""

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from ..types import DetectedShape, FloatArray, Image
from ._detector import detector_kind
from ._draw import TALLEST, contact_sheet, draw_shape
from ._features import NoFeatures, ShapeFeatureSettings, feature_names, fitted_curve, shape_features
from ._settings import ResolvedVision, VisionSettings

MAX_NAMED_IMAGES = 6
"""Largest number of names of images without a detected catheter that are listed."""


class InspectSettings(BaseModel):
    """Settings of an inspection, with the same keys as those of method 1."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vision: VisionSettings = VisionSettings()
    """How the catheter is detected."""
    features: ShapeFeatureSettings = ShapeFeatureSettings()
    """The curve that is fitted to the shape."""


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Detection in one image.

    Attributes:
        shape: the detected shape.
        features: (k,) its features, or the reason why there are none.
        settings: kind and degree of the features.
        drawing: (h, w, 3) drawing of both.
    """

    shape: DetectedShape
    features: FloatArray | NoFeatures
    settings: ShapeFeatureSettings
    drawing: Image

    def figures(self) -> dict[str, Any]:
        """Returns all of it as JSON values; None where there is no value."""
        shape = self.shape
        found = shape.centreline is not None and shape.base is not None
        figures: dict[str, Any] = {"status": shape.status.value, "detail": shape.detail, "base": None, "tip_px": None}
        if shape.base is not None and shape.centreline is not None:
            points = shape.centreline.points
            figures["base"] = {
                "origin_px": shape.base.origin_px.tolist(),
                "angle_deg": math.degrees(shape.base.angle_rad),
            }
            figures["tip_px"] = points[-1].tolist()
            figures["tip_in_base_px"] = shape.base.to_base(points[-1:])[0].tolist()
            figures["length_px"] = float(np.sum(np.hypot(*np.diff(points, axis=0).T)))
        figures["diameter_px"] = shape.diameter_px if found else None
        figures["confidence"] = shape.confidence if found else None
        figures["probability_right"] = shape.probability_right if math.isfinite(shape.probability_right) else None
        figures["features"] = None
        if isinstance(self.features, NoFeatures):
            figures["features_refused"] = self.features.detail
        else:
            names = feature_names(self.settings)
            figures["features"] = dict(zip(names, self.features.tolist(), strict=True))
        return figures

    def text(self) -> str:
        """Returns the same as lines of text."""
        figures = self.figures()
        if not self.shape.found:
            return f"not found: {figures['status'].replace('_', ' ')}: {figures['detail']}"
        (u, v), (tip_u, tip_v), (x, y) = figures["base"]["origin_px"], figures["tip_px"], figures["tip_in_base_px"]
        right = figures["probability_right"]
        right = "" if right is None else f"right with a probability of {right:.0%}, "
        lines = [
            f"found      {right}seen over {100 * figures['confidence']:.0f} % of the length",
            f"base       u {u:.1f}, v {v:.1f} px, {figures['base']['angle_deg']:+.1f} deg counter-clockwise from right",
            f"tip        u {tip_u:.1f}, v {tip_v:.1f} px; in the base frame x {x:.1f}, y {y:.1f} px",
            f"length     {figures['length_px']:.1f} px, diameter {figures['diameter_px']:.2f} px",
        ]
        if isinstance(self.features, NoFeatures):
            return "\n".join([*lines, f"no features: {self.features.detail}"])
        return "\n".join([*lines, *(f"{name:<10} {value:.6g}" for name, value in figures["features"].items())])


def inspect_image(
    image: Image,
    detect: Callable[[Image], DetectedShape],
    vision: VisionSettings | ResolvedVision,
    features: ShapeFeatureSettings | None = None,
) -> Inspection:
    """Detects the catheter in an image, computes its features, and draws mask, centreline, base frame and fitted curve.

    Args:
        image: (h, w) or (h, w, 3).
        detect: detects the shape.
        vision: settings of the detection, for the mask.
        features: kind and degree of the features; None: the defaults.

    Returns:
        Shape, features and drawing.
    """
    settings = features or ShapeFeatureSettings()
    shape = detect(image)
    values = shape_features(shape, settings)
    curve = None if isinstance(values, NoFeatures) else fitted_curve(shape, settings, values)
    mask_of = detector_kind(vision.method).mask
    mask = None if mask_of is None else mask_of(vision, image)
    return Inspection(shape, values, settings, draw_shape(image, shape, curve_px=curve, mask=mask))


@dataclass(slots=True)
class Tally:
    """Counts detections over the frames of a video, and keeps an even sample of the drawings.

    Attributes:
        room: number of drawings that are kept; up to a third of them show frames in which nothing was found.
        statuses: status -> number of frames.
        reasons: reasons of the frames in which nothing was found.
        diameters_px: diameter in each frame with a shape.
    """

    room: int = 12
    statuses: Counter[str] = field(default_factory=Counter[str])
    reasons: "Reasons" = field(default_factory=lambda: Reasons())
    diameters_px: list[float] = field(default_factory=list[float])
    images: dict[str, str] = field(default_factory=dict[str, str])
    """Name of the image file -> status, where images have names."""
    _found: "_Sample" = field(init=False)
    _lost: "_Sample" = field(init=False)

    def __post_init__(self) -> None:
        self._found, self._lost = _Sample(self.room), _Sample(max(1, self.room // 3))

    @property
    def frames(self) -> int:
        """Frames so far."""
        return sum(self.statuses.values())

    @property
    def share_found(self) -> float:
        """Share of the frames in which the catheter was found, 0 to 1."""
        return self.statuses["valid"] / max(1, self.frames)

    def add(self, title: str, inspection: Inspection, name: str = "") -> None:
        """Counts one frame.

        Args:
            title: title above its drawing.
            inspection: result of the frame.
            name: name of the image file; "" where it has none.
        """
        shape = inspection.shape
        if name:
            self.images[name] = shape.status.value
        self.statuses[shape.status.value] += 1
        if shape.found:
            self.diameters_px.append(shape.diameter_px)
        else:
            self.reasons.add(f"{shape.status.value}: {shape.detail}")
        order = self.frames
        small = _small(inspection.drawing)
        (self._found if shape.found else self._lost).add(order, f"{title}  {shape.status.value}", small)

    def contact_sheet(self, columns: int = 4) -> Image:
        """Returns the sample of the drawings in order of time. Raises ValueError before the first frame."""
        lost = self._lost.best(self._lost.room)
        kept = sorted(lost + self._found.best(self.room - len(lost)), key=lambda entry: entry[0])
        return contact_sheet([entry[2] for entry in kept], min(columns, len(kept)), [entry[1] for entry in kept])

    def figures(self) -> dict[str, Any]:
        """Returns the counts as JSON values."""
        return {
            "frames": self.frames,
            "share_found": self.share_found,
            "statuses": dict(self.statuses),
            "diameter_px": float(np.median(self.diameters_px)) if self.diameters_px else None,
            **({"images": self.images} if self.images else {}),
        }

    def text(self) -> str:
        """Returns the counts as lines of text."""
        lines = [f"found in {self.statuses['valid']} of {self.frames} frames ({100 * self.share_found:.1f} %)"]
        if self.diameters_px:
            low, middle, high = np.percentile(self.diameters_px, [5, 50, 95])
            lines[0] += f", diameter {middle:.2f} px (5 to 95 %: {low:.2f} to {high:.2f})"
        lines += self.reasons.lines(5)
        lost = [name for name, status in self.images.items() if status != "valid"]
        if lost:
            more = f" and {len(lost) - MAX_NAMED_IMAGES} more" if len(lost) > MAX_NAMED_IMAGES else ""
            lines.append(f"  not found in {', '.join(lost[:MAX_NAMED_IMAGES])}{more}")
        return "\n".join(lines)


class Reasons:
    """Counts why frames have no estimate; reasons that differ in their numbers alone count as one.

    >>> reasons = Reasons()
    >>> for text in ("lost after 80 px", "lost after 95 px", "nothing dark enters"):
    ...     reasons.add(text)
    >>> reasons.lines(2)
    ['  2 frames lost after 80 px (and other numbers)', '  1 frames nothing dark enters']
    """

    def __init__(self) -> None:
        self._examples: dict[str, Counter[str]] = {}

    def add(self, reason: str) -> None:
        """Counts one frame."""
        self._examples.setdefault(re.sub(r"-?\d+(\.\d+)?", "#", reason), Counter())[reason] += 1

    def lines(self, most: int) -> list[str]:
        """Returns the ``most`` frequent reasons, each with its first example."""
        ranked = sorted(self._examples.values(), key=lambda texts: -texts.total())[:most]
        return [
            f"  {texts.total()} frames {next(iter(texts))}{' (and other numbers)' if len(texts) > 1 else ''}"
            for texts in ranked
        ]


class _Sample:
    """An even sample of a stream of unknown length: every k-th entry, k doubled whenever there are twice too many."""

    def __init__(self, room: int) -> None:
        self.room, self.stride, self.count = room, 1, 0
        self.entries: list[tuple[int, str, Image]] = []

    def add(self, order: int, title: str, image: Image) -> None:
        if self.count % self.stride == 0:
            self.entries.append((order, title, image))
        self.count += 1
        if len(self.entries) >= 2 * self.room:
            self.entries = self.entries[::2]
            self.stride *= 2

    def best(self, count: int) -> list[tuple[int, str, Image]]:
        """Returns at most ``count`` entries, the first and last among them."""
        if len(self.entries) <= count:
            return list(self.entries)
        indices = np.linspace(0, len(self.entries) - 1, count).round().astype(int)
        return [self.entries[k] for k in indices.tolist()]


def _small(drawing: Image, width: int = 320) -> Image:
    fit = min(width / drawing.shape[1], TALLEST * width / drawing.shape[0])
    width, height = max(1, round(fit * drawing.shape[1])), max(1, round(fit * drawing.shape[0]))
    return np.asarray(cv2.resize(drawing, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
