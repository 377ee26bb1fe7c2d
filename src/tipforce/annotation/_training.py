"""Runs the fine-tuning of the detector on a thread, with progress and cancel."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from ..errors import TipforceError
from ..types import FloatArray, Image
from ..vision import Annotation

_log = logging.getLogger(__name__)

TrainingState = Literal["idle", "running", "done", "failed", "cancelled"]
Report = Callable[[str, float], None]
"""Called with the current step and the share that is done."""


class LeftOut(Protocol):
    """A frame that the training did not use, with the lines (n, 2) px that were found in it, base to tip."""

    @property
    def image(self) -> str:
        """Name of the image."""
        ...

    @property
    def before_px(self) -> FloatArray:
        """The line before the training."""
        ...

    @property
    def after_px(self) -> FloatArray:
        """The line after the training."""
        ...

    @property
    def before_present(self) -> float:
        """Probability of a catheter in the image, before the training."""
        ...

    @property
    def after_present(self) -> float:
        """Probability of a catheter in the image, after the training."""
        ...


class TrainedDetector(Protocol):
    """The result of a fine-tuning."""

    @property
    def folder(self) -> Path:
        """Folder with the detector."""
        ...

    @property
    def seconds(self) -> float:
        """Duration of the training."""
        ...

    @property
    def left_out(self) -> Sequence[LeftOut]:
        """Frames that were left out, for a picture of before and after."""
        ...


FineTune = Callable[[Sequence[Annotation], Sequence[Image], Report], TrainedDetector]
"""Fine-tunes the detector on annotated images and stores it."""


class Cancelled(Exception):
    """The person cancelled the training."""


@dataclass(frozen=True, slots=True)
class TrainingStatus:
    """State of the training.

    Attributes:
        state: idle before the first training.
        step: the current step.
        share: share that is done, 0 to 1.
        seconds: time since the beginning, or duration.
        message: reason of a failure, or where the detector was stored.
        result: the trained detector, where there is one.
    """

    state: TrainingState = "idle"
    step: str = ""
    share: float = 0.0
    seconds: float = 0.0
    message: str = ""
    result: TrainedDetector | None = None


class TrainingRun:
    """Fine-tunes on a thread of its own, one training at a time.

    Args:
        fine_tune: the fine-tuning.
    """

    def __init__(self, fine_tune: FineTune) -> None:
        self._fine_tune = fine_tune
        self._status = TrainingStatus()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._start_s = 0.0

    @property
    def status(self) -> TrainingStatus:
        """The present state."""
        status = self._status
        if status.state != "running":
            return status
        return TrainingStatus("running", status.step, status.share, time.monotonic() - self._start_s)

    @property
    def running(self) -> bool:
        """Whether a training runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, annotations: Sequence[Annotation], images: Sequence[Image]) -> None:
        """Starts a training; does nothing while one runs.

        Args:
            annotations: the marked frames.
            images: their images.
        """
        if self.running:
            return
        self._cancel.clear()
        self._start_s = time.monotonic()
        self._status = TrainingStatus("running", "starting")
        self._thread = threading.Thread(
            target=self._run, args=(annotations, images), name="tipforce-training", daemon=True
        )
        self._thread.start()

    def cancel(self) -> None:
        """Ends the training at its next step; an earlier detector stays as it was."""
        self._cancel.set()

    def close(self, timeout_s: float = 60.0) -> None:
        """Cancels the training and waits for its end."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _run(self, annotations: Sequence[Annotation], images: Sequence[Image]) -> None:
        """Trains, on the training's thread, and keeps progress and outcome in `status`; no error leaves it."""

        def report(step: str, share: float) -> None:
            if self._cancel.is_set():
                raise Cancelled
            self._status = TrainingStatus("running", step, min(1.0, max(0.0, share)))

        def ended(state: TrainingState, message: str, **more: Any) -> None:
            self._status = TrainingStatus(state, seconds=time.monotonic() - self._start_s, message=message, **more)

        try:
            result = self._fine_tune(annotations, images, report)
        except Cancelled:
            ended("cancelled", "the training was cancelled; the annotations are saved")
        except TipforceError as error:
            ended("failed", f"{error}; the annotations are saved")
        except Exception as error:
            _log.exception("the training has failed")
            ended("failed", f"the training failed ({type(error).__name__}: {error}); the annotations are saved")
        else:
            ended("done", str(result.folder), share=1.0, result=result)
