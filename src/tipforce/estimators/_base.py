"""The face that all methods share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from ..datasets import Dataset, calibration_images
from ..errors import InputError
from ..types import ForceEstimate, Image, Observation, SessionInfo
from ..vision import detector_kind
from ._facts import ModelFacts

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""


def no_progress(what: str, share: float) -> None:
    """A `Progress` that ignores its calls."""
    del what, share


class Stream(Protocol):
    """One session being estimated, frame after frame; may remember."""

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; never raises because of the content of an image."""
        ...


class Estimator(ABC):
    """A method: settings in, ``fit`` on a dataset where it needs one, then one ``Stream`` a session.

    Settings are immutable and stay as the user stated them; learnt state is in attributes that end in ``_``. A method
    without anything to learn states ``needs_fit = False`` and implements `start` alone. ``state``, ``files`` and
    ``from_state`` are all that the model store needs.
    """

    name: ClassVar[str]
    """Name of this method on the command line."""

    settings_type: ClassVar[type[BaseModel]]
    """The model of this method's settings."""

    thesis_samples: ClassVar[int] = 220
    """Number of samples that the thesis has for this method, and that its protocol draws."""

    thesis_settings: ClassVar[Mapping[str, Any] | None] = None
    """Settings with which it is the thesis's own method to the letter; None: the thesis has no such method."""

    needs_fit: ClassVar[bool] = True
    """False for a method that estimates forces from its settings and the session's metadata alone."""

    breaks: ClassVar[str] = ""
    """One sentence on where the method breaks, for tables that compare methods; empty where nobody wrote it."""

    def __init__(self, settings: Any = None) -> None:
        self.settings: Any = settings or self.settings_type()

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns from ``dataset``; a method that needs no fit has nothing to learn.

        Raises:
            InputError: the dataset is too small or lacks an input of the method.
        """
        del dataset, progress
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds the intervals anew on ``dataset``, of whose sessions ``fit`` saw none.

        The forces stay as they are, unless the method says otherwise.
        """
        del progress
        raise InputError(f"{dataset.title}: {self.name} has no intervals to calibrate; leave the calibration out")

    @abstractmethod
    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """A fresh stream for one session.

        Args:
            info: the session's metadata.
            images: some images of the session that are at hand beforehand, as of a file: a method that
                ``calibrates_on_images`` resolves its detection on them. Without them it does so as the frames come.

        Raises:
            NotFittedError: before ``fit``, for a method that needs it.
        """

    def unfitted(self) -> Self:
        """Returns the same method with the same settings, not fitted: each split trains one."""
        return type(self)(self.settings)

    def with_settings(self, settings: BaseModel) -> Self:
        """`unfitted` with other settings."""
        made = self.unfitted()
        made.settings = settings
        return made

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the learnt state as JSON values and arrays."""
        return {}, {}

    def files(self) -> dict[str, bytes]:
        """Returns further learnt state as whole files of the model folder: name -> content (a graph, a log)."""
        return {}

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,
    ) -> Self:
        """The inverse of `state` and `files`."""
        del values, arrays, files
        return cls(cls.settings_type.model_validate(settings))

    def estimates(self, dataset: Dataset) -> Iterator[ForceEstimate]:
        """One stream a session over all samples, in the dataset's order, as they are asked for."""
        stream, session = None, None
        for name, observation in zip(dataset.session.tolist(), dataset.observations(), strict=True):
            if stream is None or name != session:
                info, session = dataset.session_info[name], name
                if self.calibrates_on_images:
                    stream = self.start(info, calibration_images(dataset, name, self.views[0]))
                else:
                    stream = self.start(info)
            yield stream.update(observation).checked()

    def predict(self, dataset: Dataset, progress: Callable[[float], None] | None = None) -> list[ForceEstimate]:
        """Estimates for the samples of ``dataset``, one stream a session.

        A method that ``uses_history`` is shown all frames of these sessions, as far as the dataset they are a part of
        holds them, and the estimates of the samples themselves are returned.
        """
        run = dataset
        if self.uses_history and dataset.whole is not None:
            run = dataset.whole.subset(np.isin(dataset.whole.session, list(dataset.sessions)))
        found: dict[int, ForceEstimate] = {}
        for row, estimate in zip(run.rows.tolist(), self.estimates(run), strict=True):
            found[row] = estimate
            if progress is not None:
                progress(len(found) / len(run))
        return [found[row] for row in dataset.rows.tolist()]

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views that it looks at; the first one sets the pace."""
        return ("camera",)

    @property
    def calibrates_on_images(self) -> bool:
        """True where detection is resolved session by session on the session's own images."""
        return False

    @property
    def uses_history(self) -> bool:
        """True where an estimate depends on earlier frames of the session, too."""
        return False

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """Names of the actuation without which there is no estimate."""
        return ()

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """Keys of the session metadata without which there is no estimate, as `SessionInfo.stated_keys` names them."""
        return ()

    @property
    def training_sessions(self) -> frozenset[str]:
        """Fingerprints of sessions that are not new to this method, fitted or not: those of its initial model, too."""
        return frozenset()

    def describe(self) -> ModelFacts:
        """Returns facts of the fitted model, which its card and reports show."""
        return ModelFacts()

    def to_onnx(self) -> tuple[bytes, dict[str, Any]]:
        """Returns the fitted method as an ONNX graph, and facts about it; raises InputError where there is none."""
        raise InputError(f"the method {self.name} has no ONNX export")


class CentrelineEstimator(Estimator):
    """A method that reads the centreline detected in one view; its settings have ``vision``."""

    @property
    def views(self) -> tuple[str, ...]:
        """The view of the vision settings."""
        return (self.settings.vision.view,)

    @property
    def calibrates_on_images(self) -> bool:
        """Length, look of the tip and threshold are each session's own."""
        return detector_kind(self.settings.vision.method).by_session


class FineTunable(Estimator):
    """A method that is trained in epochs: it may be fine-tuned from another model and be resumed from checkpoints."""

    @abstractmethod
    def fine_tuned_from(self, model: "FineTunable") -> Self:
        """The same settings, whose fits begin with the weights of ``model``. Raises InputError for another method's."""

    @abstractmethod
    def fit_resumable(
        self, dataset: Dataset, progress: Progress | None = None, *, folder: Path | None = None, resume: bool = False
    ) -> Self:
        """`fit` with its run directory ``folder``; ``resume``: go on from the checkpoint in it."""

    @property
    @abstractmethod
    def run_files(self) -> frozenset[str]:
        """Names of the files that a training leaves in its run directory."""
