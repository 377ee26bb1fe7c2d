"""The face that all methods share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from ..datasets import Dataset
from ..types import ForceEstimate, Observation, SessionInfo
from ._summary import ModelSummary

__all__ = ["Estimator", "Progress", "Stream"]

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done (0..1)."""


class Stream(Protocol):
    """One session being estimated, frame after frame; may remember."""

    def update(self, observation: Observation) -> ForceEstimate:
        """The force at this observation, from it and those before it; never raises for what a picture shows."""
        ...


class Estimator(ABC):
    """A method: settings in, ``fit`` on a dataset, then one ``Stream`` a session. No logic in ``__init__``.

    Fitted attributes end in ``_``. ``state``, ``files`` and ``from_state`` are all that the model store needs.
    """

    name: ClassVar[str]
    """What the command line calls this method."""

    settings_type: ClassVar[type[BaseModel]]
    """The model of this method's settings."""

    settings: Any
    """An instance of ``settings_type``."""

    thesis_samples: ClassVar[int] = 220
    """So many samples the thesis has for this method: what its protocol draws."""

    @abstractmethod
    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learn from ``dataset``; raises InputError where it is too small or lacks what the method needs."""

    @abstractmethod
    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Find the intervals anew on ``dataset``, of whose sessions ``fit`` saw none; the answers stay as they are."""

    @abstractmethod
    def start(self, info: SessionInfo) -> Stream:
        """A fresh stream for one session; raises NotFittedError before ``fit``."""

    @abstractmethod
    def unfitted(self) -> Self:
        """The same recipe without what was learnt: what a split trains anew."""

    @abstractmethod
    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """What was learnt, as JSON values and arrays."""

    def files(self) -> dict[str, bytes]:
        """What else was learnt, as whole files of the model folder: name -> content (a network's graph, a log)."""
        return {}

    @classmethod
    @abstractmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,
    ) -> Self:
        """The inverse of `state` and `files`."""

    def estimates(self, dataset: Dataset) -> Iterator[ForceEstimate]:
        """One stream a session over all samples, in the dataset's order, as they are asked for."""
        stream, session = None, None
        for name, observation in zip(dataset.session.tolist(), dataset.observations(), strict=True):
            if stream is None or name != session:
                stream, session = self.start(dataset.session_info[name]), name
            yield stream.update(observation)

    def predict(self, dataset: Dataset) -> list[ForceEstimate]:
        """All `estimates`."""
        return list(self.estimates(dataset))

    def answers(self, part: Dataset, progress: Callable[[float], None] | None = None) -> list[ForceEstimate]:
        """As `predict`, but a method that remembers is shown all frames of the sessions that ``part`` is of."""
        run = part
        if self.uses_history and part.whole is not None:
            run = part.whole.subset(np.isin(part.whole.session, list(part.sessions)))
        found: dict[int, ForceEstimate] = {}
        for row, estimate in zip(run.rows.tolist(), self.estimates(run), strict=True):
            found[row] = estimate
            if progress is not None:
                progress(len(found) / len(run))
        return [found[row] for row in part.rows.tolist()]

    @property
    def uses_history(self) -> bool:
        """True where an estimate depends on earlier frames of the session, too: evaluation then runs all of them."""
        return False

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """Names of the actuation without which this fitted method answers nothing."""
        return ()

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """Keys of the session metadata without which there is no estimate, as `SessionInfo.stated_keys` names them."""
        return ()

    @property
    def training_sessions(self) -> frozenset[str]:
        """Sessions that are not new to this fitted method, if it began with one that had learnt: those of both."""
        return frozenset()

    def describe(self) -> dict[str, Any]:
        """Facts of the fitted model that a model card shows (chosen constants, number of samples, interval basis)."""
        return {}

    @classmethod
    def summary(cls, facts: Mapping[str, Any]) -> ModelSummary:
        """Returns the summary of a fitted model with these `describe`d facts, in words."""
        del facts
        return ModelSummary()
