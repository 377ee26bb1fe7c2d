"""A session of annotating: the chosen frames, the line that is proposed in each, and the marks of the person."""

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import DetectedShape, FloatArray, Image
from ..vision import Annotation
from ._carry import carried_line
from ._images import thumbnail
from ._spline import LINE_POINTS, curve_through, handles_of, line_distance_px
from ._store import AnnotationStore, MarkedFrame

RIGHT_WITHIN_PX = 3.0
"""The detector was right in a finished frame if its line is within this median distance of the person's, px."""
MIN_WITH_CATHETER = 2
"""Finished frames with a catheter that a training needs."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """The line that is shown in a frame before the person marks it.

    Attributes:
        points_px: (k, 2) points that can be dragged; (0, 2) without a line.
        carried_from: name of the finished frame whose line was carried here; "" for the detector's own line.
        detail: why the detector found nothing, or "".
    """

    points_px: FloatArray
    carried_from: str = ""
    detail: str = ""

    @classmethod
    def of_shape(cls, shape: DetectedShape) -> "Proposal":
        """Returns the line of a detected shape as points that can be dragged."""
        if shape.centreline is None:
            return cls(np.empty((0, 2)), detail=shape.detail or shape.status.replace("_", " "))
        return cls(handles_of(shape.centreline.points))


def uncertainty_of(shape: DetectedShape) -> float:
    """Returns how uncertain a detection is, 0 to 1: 1 where nothing was detected."""
    if not shape.found:
        return 1.0
    certain = shape.confidence if math.isnan(shape.probability_right) else shape.probability_right
    return 1.0 - min(1.0, max(0.0, certain))


class AnnotationSession:
    """The frames that a person marks, in one place for all pages; safe to use from several threads.

    Args:
        store: the frames and their marks; it is saved after each change.
        images: the images of the frames, in the order of the store.
        groups: the recording that each frame belongs to; lines are carried within one recording only.
        shapes: the detected shape of each frame.
    """

    def __init__(
        self, store: AnnotationStore, images: Sequence[Image], groups: Sequence[int], shapes: Sequence[DetectedShape]
    ) -> None:
        self._store, self.images, self._groups = store, list(images), list(groups)
        self._lock = threading.RLock()
        self._detected = [Proposal.of_shape(shape) for shape in shapes]
        self._thumbnails = np.array([thumbnail(image) for image in images])
        self._carried: dict[tuple[int, int], FloatArray] = {}

    def __len__(self) -> int:
        return len(self.images)

    @property
    def file(self) -> str:
        """File with the annotations."""
        return str(self._store.file)

    @property
    def frames(self) -> list[MarkedFrame]:
        """The frames with the marks so far."""
        with self._lock:
            return list(self._store.frames.values())

    def mark(self, index: int, values: Mapping[str, Any]) -> None:
        """Replaces the marks of a frame and saves all.

        Args:
            index: number of the frame, from 0.
            values: ``points_px``, ``tip_hidden``, ``present`` and ``done``.

        Raises:
            InputError: a value is refused.
            OutputError: the file cannot be written; the marks stay as they were.
        """
        with self._lock:
            before = self.frames[index]
            marked = replace(MarkedFrame.from_values(before.image, values), thumbnail=before.thumbnail)
            try:
                self._store.add([marked])
            except Exception:
                self._store.frames[before.image] = before
                raise
            self._carried = {pair: line for pair, line in self._carried.items() if pair[0] != index}

    def proposals(self) -> list[Proposal]:
        """Returns the proposal for each frame.

        Where the detector was right in the most similar finished frame, its own line is proposed. Elsewhere the line of
        that frame is carried here.
        """
        with self._lock:
            frames = self.frames
            done = [k for k, frame in enumerate(frames) if frame.done and frame.present]
            return [
                self._detected[k] if frame.done else self._proposal(k, frames, done) for k, frame in enumerate(frames)
            ]

    def annotations(self) -> tuple[list[Annotation], list[Image]]:
        """Returns the finished frames for a training, and their images.

        Raises:
            InputError: fewer than `MIN_WITH_CATHETER` frames with a catheter are finished.
        """
        with self._lock:
            done = [(frame, image) for frame, image in zip(self.frames, self.images, strict=True) if frame.done]
        check_enough([frame for frame, _ in done])
        return [frame.annotation() for frame, _ in done], [image for _, image in done]

    def _proposal(self, index: int, frames: Sequence[MarkedFrame], done: Sequence[int]) -> Proposal:
        """Returns the proposal for a frame that is not finished; see `proposals`.

        Args:
            index: number of the frame.
            frames: all frames.
            done: numbers of the finished frames with a catheter.
        """
        detected = self._detected[index]
        same_recording = [k for k in done if self._groups[k] == self._groups[index]]
        if not same_recording:
            return detected
        distances = np.linalg.norm(self._thumbnails[same_recording] - self._thumbnails[index], axis=1)
        nearest = same_recording[int(np.argmin(distances))]
        if len(detected.points_px) and self._detector_was_right(nearest, frames[nearest]):
            return detected
        if (nearest, index) not in self._carried:
            line = carried_line(frames[nearest].points_px, self.images[nearest], self.images[index])
            self._carried[nearest, index] = line
        return Proposal(self._carried[nearest, index], carried_from=frames[nearest].image)

    def _detector_was_right(self, index: int, frame: MarkedFrame) -> bool:
        detected = self._detected[index].points_px
        if not len(detected):
            return False
        lines = (curve_through(points, LINE_POINTS) for points in (detected, frame.points_px))
        return line_distance_px(*lines) <= RIGHT_WITHIN_PX


def check_enough(finished: Sequence[MarkedFrame]) -> None:
    """Checks whether the finished frames suffice for a training.

    Raises:
        InputError: fewer than `MIN_WITH_CATHETER` of them show a catheter.
    """
    count = sum(frame.present for frame in finished)
    if count < MIN_WITH_CATHETER:
        raise InputError(
            f"{count} finished frames show a catheter; a training needs at least {MIN_WITH_CATHETER}, better 8: mark "
            "its line in more frames"
        )
