"""Inputs that every method reads from an observation, and the reason where one is missing."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets import Dataset
from ..errors import InputError
from ..types import (
    ADVANCE,
    KNOB,
    FloatArray,
    Image,
    Observation,
    SessionInfo,
    ShapeFeatures,
    Status,
    View,
    actuation_range,
)


@dataclass(frozen=True, slots=True)
class Abstention:
    """Reason why an observation has no estimate.

    Attributes:
        status: status of the estimate.
        detail: the reason in words.
    """

    status: Status
    detail: str


def read_view(observation: Observation, view: str, setting: str) -> View | Abstention:
    """Returns the content of one view of an observation.

    Args:
        observation: the input.
        view: name of the view.
        setting: name of the setting that names it, for the reason.
    """
    content = observation.views.get(view)
    if content is None:
        there = ", ".join(observation.views) or "none"
        return Abstention(Status.MISSING_INPUT, f"there is no view {view!r}, as {setting} says; there is {there}")
    return content


def read_image(observation: Observation, view: str, setting: str) -> Image | Abstention:
    """Returns the image of a view, or an abstention where there are only shape features.

    Args:
        observation: the sample.
        view: name of the view.
        setting: the setting that names it, for the abstention.
    """
    content = read_view(observation, view, setting)
    if isinstance(content, ShapeFeatures):
        return Abstention(Status.MISSING_INPUT, "this method needs images; these data are shape features")
    return content


def read_actuation(observation: Observation, names: Sequence[str]) -> FloatArray | Abstention:
    """Returns the actuation values that a model was trained with.

    Args:
        observation: the sample.
        names: names of the k values.

    Returns:
        (k,) values; an abstention where one is absent.
    """
    values = np.empty(len(names))
    for place, name in enumerate(names):
        value = observation.actuation.get(name)
        if value is None or math.isnan(value):
            return Abstention(Status.MISSING_INPUT, f"{name}, which this model was trained with, is absent; state it")
        values[place] = value
    return values


def read_advance_m(observation: Observation) -> float | Abstention:
    """Returns the distance in m by which the clamp has been advanced along the base x axis from its stated position.

    It is 0 where the observation has no such value. Methods shift the image by it (`vision.image_from_clamp`), as if
    the camera moved with the clamp; the rest of the geometry does not change.
    """
    advance_m = 1e-3 * observation.actuation.get(ADVANCE, 0.0)
    if math.isfinite(advance_m):
        return advance_m
    return Abstention(Status.MISSING_INPUT, f"{ADVANCE} is not known at this image, nor is the position of the base")


def actuation_names(wanted: Sequence[str] | None, dataset: Dataset) -> tuple[str, ...]:
    """Returns the names of the actuation to train with.

    Args:
        wanted: the names; None: all of ``dataset``.
        dataset: the training data.

    Raises:
        InputError: ``dataset`` lacks one of them.
    """
    names = tuple(dataset.actuation) if wanted is None else tuple(wanted)
    for name in names:
        if name not in dataset.actuation:
            there = ", ".join(dataset.actuation) or "none"
            raise InputError(f"{dataset.title}: has no actuation {name!r}; it has {there}")
    return names


LIMIT_MARGIN = 0.1
"""Margin of the actuation limits, see `limits_of`."""

MAX_PRECURVATURE_PER_M = 60.0
"""Largest curvature that a knob produces: the full bend of a 7F ablation catheter, 90 degrees of its knob, is 48
1/m."""


def limits_of(names: Iterable[str], dataset: Dataset) -> dict[str, tuple[float, float]]:
    """Returns the smallest and largest value of each actuation for which a trained model estimates.

    They are those of the data with a margin, which is a tenth of the largest of three values: the range, the largest
    absolute value, one unit. So a drive that did not move in training may be read with some error. Actuation that the
    data lack has no limits.

    Args:
        names: names of the actuation.
        dataset: the training data.
    """
    limits: dict[str, tuple[float, float]] = {}
    for name in names:
        values = dataset.actuation.get(name, np.empty(0))
        values = values[np.isfinite(values)]
        if len(values):
            low, high = float(values.min()), float(values.max())
            margin = LIMIT_MARGIN * max(high - low, abs(low), abs(high), 1.0)
            limits[name] = low - margin, high + margin
    return limits


def unlike_training(
    observation: Observation, limits: Mapping[str, tuple[float, float]], names: Iterable[str], info: SessionInfo
) -> Abstention | None:
    """Returns the reason why there is no estimate where a drive is unlike its readings in training; None where none is.

    Args:
        observation: the input of the estimate.
        limits: limits of the actuation values, see `limits_of`.
        names: actuation that the method reads; a value without limits, as in models that were saved before limits
            existed, must at least be plausible: see `implausible_actuation`.
        info: the session's metadata.
    """
    for name, (low, high) in limits.items():
        value = observation.actuation.get(name)
        if value is not None and not low <= value <= high:
            detail = (
                f"the actuation is unlike the training data ({name} {value:g}, the limits are {low:g} and {high:g})"
            )
            return Abstention(Status.OUT_OF_DISTRIBUTION, detail)
    open_names = [name for name in names if name not in limits and name in observation.actuation]
    return implausible_actuation({name: observation.actuation[name] for name in open_names}, info)


def implausible_actuation(actuation: Mapping[str, float], info: SessionInfo) -> Abstention | None:
    """Returns the reason why no catheter is actuated like this, independent of the training data; None if it may be.

    Args:
        actuation: values by name; NaN: the value is missing.
        info: the session's metadata, with the gain of the knob if that is known.
    """
    for name, value in actuation.items():
        expected, gain = actuation_range(name), info.actuation.knob_gain_per_m_deg
        if expected.outside(np.array([value])) is not None:
            return Abstention(Status.OUT_OF_DISTRIBUTION, f"{name} {value:g} is no such reading: expected {expected}")
        if name == KNOB and gain is not None and abs(gain * value) > MAX_PRECURVATURE_PER_M:
            return Abstention(
                Status.OUT_OF_DISTRIBUTION,
                f"at {value:g} degrees the knob would produce a curvature of {gain * value:.3g} 1/m, more than "
                f"{MAX_PRECURVATURE_PER_M:g} 1/m",
            )
    return None
