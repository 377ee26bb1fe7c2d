"""The catheter's shape for who looks on, where the method itself detects none (a network)."""

from concurrent.futures import Future, ThreadPoolExecutor

from ..types import DetectedShape, Image, SessionInfo
from ..vision import ResolvedVision, SessionCalibration, ShapeDetector, VisionSettings

__all__ = ["ShapeFinder"]


class ShapeFinder:
    """Detects the catheter in the images of one view, from when its first images have resolved how.

    Detection takes a tenth of a millisecond. Resolving it takes up to a second, on a thread of its own; images that
    come meanwhile are left out of it.
    """

    def __init__(self, view: str, info: SessionInfo) -> None:
        self._calibration = SessionCalibration(VisionSettings(view=view), info)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="live-shape")
        self._task: Future[ResolvedVision | None] | None = None
        self._detector: ShapeDetector | None = None

    def find(self, image: Image) -> DetectedShape | None:
        """The shape in ``image``, or why there is none; None while it is not resolved."""
        task = self._task
        if task is None or task.done():
            if task is not None and (found := task.result()) is not None:
                self._detector = ShapeDetector(found)
            self._task = self._pool.submit(self._calibration.add, image)
        return None if self._detector is None else self._detector.detect(image)

    def close(self) -> None:
        """No image comes any more."""
        self._pool.shutdown(wait=False, cancel_futures=True)
