"""The interface that all methods share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from ..datasets import Dataset, calibration_images
from ..errors import InputError
from ..types import DEFAULT_VIEW, ForceEstimate, Image, Observation, SessionInfo, missing_views, views_text
from ..vision import detector_kind
from ._facts import ModelFacts
from ._session_metadata import missing_metadata, turned_view
from ._values import StoredArrays, StoredFiles, StoredValues
from ._view_setting import is_stated, with_value

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""


def no_progress(task: str, share: float) -> None:
    """Ignores its calls; a `Progress` for work that nobody watches.

    Args:
        task: the current work.
        share: its finished share, 0 to 1.
    """
    del task, share


class Stream(Protocol):
    """Estimates the forces of one session, frame after frame; it may keep a state between frames."""

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; never raises an error because of the content of an image."""
        ...


class Estimator(ABC):
    """A method: it has settings, ``fit`` on a dataset where it needs one, and one ``Stream`` for each session.

    Settings are immutable and stay as the user stated them; the learnt state is in attributes that end in ``_``. A
    method without a learnt state has ``needs_fit = False`` and implements `start` alone. The model store needs
    ``state``, ``files`` and ``from_state`` only.
    """

    name: ClassVar[str]
    """Name of this method on the command line."""

    settings_type: ClassVar[type[BaseModel]]
    """The model of this method's settings."""

    thesis_samples: ClassVar[int] = 220
    """Number of samples that the thesis uses for this method; its protocol draws as many."""

    thesis_settings: ClassVar[Mapping[str, Any] | None] = None
    """Settings that make it exactly the method of the thesis; None: the thesis has no such method."""

    needs_fit: ClassVar[bool] = True
    """False for a method that estimates forces from its settings and the session metadata alone."""

    breaks: ClassVar[str] = ""
    """One sentence on the limits of the method, for tables that compare methods; empty where none is stated."""

    view_setting: ClassVar[str] = ""
    """Setting that names the view, as ``vision.view``; empty for a method that does not read one view."""

    def __init__(self, settings: Any = None) -> None:
        self.settings: Any = settings or self.settings_type()

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns from a dataset; a method with ``needs_fit = False`` does nothing.

        Args:
            dataset: the training data.
            progress: called with the current work and its finished share.

        Returns:
            The method itself.

        Raises:
            InputError: the dataset is too small or lacks an input of the method.
        """
        del dataset, progress
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds new intervals on sessions that ``fit`` did not use.

        The forces stay as they are, unless the method states otherwise.

        Args:
            dataset: the calibration sessions.
            progress: called with the current work and its finished share.

        Returns:
            The method itself.

        Raises:
            InputError: the method has no intervals to calibrate.
        """
        del progress
        raise InputError(f"{dataset.title}: {self.name} has no intervals to calibrate; leave the calibration out")

    @abstractmethod
    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """Returns a new stream for one session.

        Args:
            info: the session's metadata.
            images: some images of the session, where they are available beforehand, as from a file. A method that
                ``calibrates_on_images`` resolves its detection on them; without them it does so while the frames come.

        Raises:
            NotFittedError: before ``fit``, for a method that needs it.
        """

    def start_on(self, info: SessionInfo, images: Mapping[str, Sequence[Image]]) -> Stream:
        """Returns a new stream for one session whose images are available beforehand.

        Args:
            info: the session's metadata.
            images: some images of the session by view, see `start`. Those of the first view are used, unless the method
                resolves its detection in several views.

        Raises:
            NotFittedError: see `start`.
        """
        first = images.get(self.views[0], ()) if images else ()
        # a method that resolves nothing on images need not take any
        return self.start(info, first) if first else self.start(info)

    def unfitted(self) -> Self:
        """Returns the same method with the same settings, not fitted; each split trains such a copy."""
        return type(self)(self.settings)

    def with_settings(self, settings: BaseModel) -> Self:
        """Returns an unfitted method with other settings."""
        made = self.unfitted()
        made.settings = settings
        return made

    @property
    def view_is_stated(self) -> bool:
        """True where a person or the training chose the views; otherwise any view of the data may be read."""
        return not self.view_setting or is_stated(self.settings, self.view_setting)

    def reading(self, view: str) -> Self:
        """Returns this method, fitted or not, for another view; only for a method that reads one.

        Args:
            view: name of the view.

        Raises:
            InputError: the method does not read one view.
        """
        if not self.view_setting:
            raise InputError(f"{self.name} reads {views_text(self.views)}; no other view can be chosen")
        made = copy(self)
        made.settings = with_value(self.settings, self.view_setting, view)
        return made

    def for_views(self, there: Iterable[str]) -> Self:
        """Returns this method for data with the views ``there``.

        All code that brings a method and data together calls it. A method of one view whose view nobody chose reads the
        first one where its default view is absent.

        Args:
            there: views of the data, the first one first; empty where they are not known.

        Returns:
            The method itself where it needs no change, or states no views.

        Raises:
            InputError: a view that the method reads is absent.
        """
        names = tuple(there)
        lacking = [view for view in self.views if names and view not in names]
        states_views = bool(self.view_setting) or type(self).views is not Estimator.views
        if not lacking or not states_views:
            return self
        if self.view_is_stated:
            raise InputError(f"{missing_views(lacking, names)}, and {self.name} reads {views_text(self.views)}")
        return self.reading(names[0])

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the learnt state as JSON values and arrays."""
        return {}, {}

    def files(self) -> dict[str, bytes]:
        """Returns further learnt state as whole files of the model folder: name -> content (a graph, a log)."""
        return {}

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Makes a fitted method from its saved state; the inverse of `state` and `files`.

        Args:
            settings: the settings as JSON values.
            values: the JSON values of `state`.
            arrays: the arrays of `state`.
            files: the files of `files`.
        """
        del values, arrays, files
        return cls(cls.settings_type.model_validate(settings))

    def estimates(self, dataset: Dataset) -> Iterator[ForceEstimate]:
        """Yields the estimates of all samples in the order of the dataset, with one stream for each session."""
        stream, session = None, None
        for name, observation in zip(dataset.session.tolist(), dataset.observations(), strict=True):
            if stream is None or name != session:
                info, session = dataset.session_info[name], name
                views = self.views if self.calibrates_on_images else ()
                stream = self.start_on(info, {view: calibration_images(dataset, name, view) for view in views})
            yield stream.update(observation).checked()

    def predict(self, dataset: Dataset, progress: Callable[[float], None] | None = None) -> list[ForceEstimate]:
        """Returns the estimates of all samples, with one stream for each session.

        A method that ``uses_history`` gets all frames of these sessions that the whole dataset has, but only the
        estimates of the samples themselves are returned.

        Args:
            dataset: the samples.
            progress: called with the finished share.
        """
        frames = dataset
        if self.uses_history and dataset.whole is not None:
            frames = dataset.whole.subset(np.isin(dataset.whole.session, list(dataset.sessions)))
        by_row: dict[int, ForceEstimate] = {}
        for row, estimate in zip(frames.rows.tolist(), self.estimates(frames), strict=True):
            by_row[row] = estimate
            if progress is not None:
                progress(len(by_row) / len(frames))
        return [by_row[row] for row in dataset.rows.tolist()]

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views that the method reads; the first one sets the frame rate."""
        return (DEFAULT_VIEW,)

    @property
    def needs_all_views(self) -> bool:
        """False where an observation may have any one of the views.

        Then each image that is taken apart from those of the other views is an observation of its own, and a view that
        is lost does not end the estimates.
        """
        return True

    @property
    def calibrates_on_images(self) -> bool:
        """True where detection is resolved for each session on its own images."""
        return False

    @property
    def uses_history(self) -> bool:
        """True where an estimate also depends on earlier frames of the session."""
        return False

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """Names of the actuation values without which there is no estimate."""
        return ()

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """Keys of the session metadata without which there is no estimate, as `SessionInfo.stated_keys` names them."""
        return ()

    def obstacle(self, info: SessionInfo) -> str:
        """Returns the reason why there is no estimate in any session with these metadata; empty where there may be."""
        return missing_metadata(self.required_metadata, info)

    @property
    def training_sessions(self) -> frozenset[str]:
        """Fingerprints of the training sessions of this method, and of those of its initial model."""
        return frozenset()

    def describe(self) -> ModelFacts:
        """Returns facts of the fitted model for its card and reports."""
        return ModelFacts()

    def to_onnx(self) -> tuple[bytes, dict[str, Any]]:
        """Returns the fitted method as an ONNX graph, and facts about it. Raises InputError where it has no export."""
        raise InputError(f"the method {self.name} has no ONNX export")


class CentrelineEstimator(Estimator):
    """A method that reads the centreline detected in one view; its settings have ``vision``."""

    view_setting = "vision.view"

    @property
    def views(self) -> tuple[str, ...]:
        """The view of the vision settings."""
        return (self.settings.vision.view,)

    @property
    def calibrates_on_images(self) -> bool:
        """True where the tip template, the length and the threshold are resolved for each session."""
        return detector_kind(self.settings.vision.method).by_session


class PlanarRodEstimator(CentrelineEstimator):
    """A method that fits a planar rod to the centreline; the view must show the plane of the base frame."""

    def obstacle(self, info: SessionInfo) -> str:
        """See `Estimator.obstacle`; also the reason where the view shows another plane."""
        return super().obstacle(info) or turned_view(self.views[0], info)

    def check_views(self, dataset: Dataset) -> None:
        """Raises InputError where the view of a session shows another plane: nothing is learnt from it."""
        for name, info in dataset.session_info.items():
            if reason := turned_view(self.views[0], info):
                raise InputError(f"{dataset.title}: {name}: {reason}")


class FineTunable(Estimator):
    """A method that is trained in epochs: it can be fine-tuned from another model and resumed from checkpoints."""

    @abstractmethod
    def fine_tuned_from(self, model: "FineTunable") -> Self:
        """Returns a copy with the same settings whose fits start from the weights of ``model``.

        Raises:
            InputError: ``model`` is of another method.
        """

    @abstractmethod
    def fit_resumable(
        self, dataset: Dataset, progress: Progress | None = None, *, folder: Path | None = None, resume: bool = False
    ) -> Self:
        """Fits with a run directory.

        Args:
            dataset: the training data.
            progress: called with the current work and its finished share.
            folder: the run directory.
            resume: continue from the checkpoint in it.

        Returns:
            The method itself.
        """

    @property
    @abstractmethod
    def run_files(self) -> frozenset[str]:
        """Names of the files that a training writes to its run directory."""
