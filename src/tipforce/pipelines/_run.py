"""Memory of a run while it is recorded, and the detection of the catheter in its images."""

from array import array
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from ..alignment import DetectedShapes, StageMotion
from ..errors import InputError
from ..types import STAGE, Event, FloatArray, Frame, Image, IntArray, SessionInfo, Status, Wrench, ordered_views
from ..vision import DetectedShape, ShapeDetector, VisionSettings, auto_calibrate, with_advice

_FIRST, _EVERY = (50, 100), 5
"""Frames on which vision is calibrated first, ten images of them or every fifth: a catheter that waits for the first
ones may be found in the second ones."""
KEPT_IMAGES = 16
"""Images from all over the run on which it is calibrated again, whenever the run has doubled."""


class Run:
    """Memory of the written events: stamps of the frames, readings of the force, the stage."""

    def __init__(self, progress: Callable[[int], None] | None) -> None:
        self._progress, self._count = progress, 0
        self._frames: list[tuple[int, str]] = []
        self._force_ns, self._force_n = array("q"), array("d")  # an hour at 1 kHz takes 115 MB
        self._stage: list[tuple[int, Mapping[str, float]]] = []

    def add(self, event: Event) -> None:
        """Remembers ``event``."""
        if isinstance(event, Frame):
            self._frames.append((event.stamp_ns, event.view))
            self._count += 1
            if self._progress:
                self._progress(self._count)
        elif isinstance(event, Wrench):
            self._force_ns.append(event.stamp_ns)
            self._force_n.extend(event.force_n)
        elif event.stream == STAGE:
            self._stage.append((event.stamp_ns, event.values))

    def stamps(self, view: str | None) -> IntArray:
        """Returns (n,) stamps of the frames of ``view``, or of all."""
        return np.array([stamp for stamp, name in self._frames if view in (None, name)], dtype=np.int64)

    @property
    def force(self) -> tuple[IntArray, FloatArray]:
        """(n,) stamps and (n, 3) readings."""
        return np.frombuffer(self._force_ns, np.int64), np.frombuffer(self._force_n).reshape(-1, 3)

    @property
    def stage(self) -> StageMotion:
        """Motion of the stage, where it has readings."""
        return StageMotion.of(self._stage)


class RunDetector:
    """Detects the catheter in each frame of one view, see `VisionSettings.for_views`."""

    def __init__(self, info: SessionInfo, settings: VisionSettings) -> None:
        self._context, self._settings = info, settings
        self.blind = ""
        """Why no catheter is detected at all, or empty."""
        self.view = settings.view
        self.shapes: list[DetectedShape] = []
        self._detect: Callable[[Image], DetectedShape] | None = None
        self._has_view = True
        self._head: list[Frame] | None = []
        self._counts: Counter[str] = Counter()
        self._kept: list[Image] = []
        self._every = _EVERY

    def take(self, frame: Frame) -> None:
        """Takes the next frame; the first ones wait until there are enough to resolve the detection on."""
        if self._head is None:
            self._detect_in(frame)
            return
        self._head.append(frame)
        self._counts[frame.view] += 1
        if self._counts[frame.view] in _FIRST:
            self._begin(last=self._counts[frame.view] == _FIRST[-1])

    def finish(self) -> None:
        """Detects the catheter in the first frames, even if there are few."""
        if self._head is not None:
            self._begin(last=True)

    def of_run(self, run: Run) -> DetectedShapes:
        """Finishes the detection, and returns the shapes in all frames of a run, with their stamps.

        Where no catheter is detected at all, the result has the reason and no shapes, with the stamps of all views.
        """
        self.finish()
        if self.blind:
            return DetectedShapes(run.stamps(None), [], self.view, self.blind)
        return DetectedShapes(run.stamps(self.view), self.shapes, self.view)

    def _begin(self, *, last: bool) -> None:
        """Resolves the detection's settings on the first frames, then detects the catheter in them.

        Args:
            last: False: a catheter that is not found in these frames may be found with more of them, which are waited
                for; True: no more are waited for, and the reason is kept in `blind`.
        """
        head = self._head or []
        images: list[Image] = []
        try:
            self._settings = self._settings.for_views(ordered_views(self._counts), self._context.name)
            self.view = self._settings.view
            images = [frame.image for frame in head if frame.view == self.view]
            images = images[:: max(_EVERY, len(images) // 10)]  # some ten, spread over the frames
            self._detect = self._calibrated(images)
        except InputError as error:  # the recording is worth having without its clock map
            if not last:
                return
            self._has_view = bool(images)
            self.blind = with_advice(error, self._settings, images, self._context, whole=False)
        self._head = None
        for frame in head:
            self._detect_in(frame)

    def _calibrated(self, images: list[Image]) -> Callable[[Image], DetectedShape]:
        vision = auto_calibrate(self._settings, images, self._context, whole=False)
        if vision.locator is not None and vision.locator.tracer:
            # lines of one detector only: a change from one to the other looks like a movement of the tip
            vision = vision.model_copy(update={"locator": None})
        return ShapeDetector(vision).detect

    def _detect_in(self, frame: Frame) -> None:
        """Adds the shape in a frame of the view to `shapes`; then calibrates again if the run has doubled."""
        if not self._has_view or frame.view != self.view:
            return
        no_catheter = DetectedShape(Status.NO_CATHETER, self.blind)
        self.shapes.append(no_catheter if self._detect is None else self._detect(frame.image))
        if detect := self._calibrated_again(frame.image):
            self._detect, self.blind = detect, ""

    def _calibrated_again(self, image: Image) -> Callable[[Image], DetectedShape] | None:
        """Returns a detector calibrated on more of the run, whenever the run has doubled; None: not now.

        A catheter at rest hides its background, so that the first frames alone may mislead the detection.
        """
        if (len(self.shapes) - 1) % self._every == 0:
            self._kept.append(image)
        if len(self._kept) < 2 * KEPT_IMAGES:
            return None
        self._kept, self._every = self._kept[::2], 2 * self._every  # every second image, half as often from now on
        try:
            return self._calibrated(self._kept)
        except InputError:
            return None
