"""Out-of-distribution detection: images whose features are far from the features of the training images.

The distance is measured along the principal directions of the training features (Mahalanobis distance; Lee et al. 2018)
and in the residual beside them. A fine-tuned network keeps the distributions of the network it was fine-tuned from, as
long as those contain the new training images, too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, ForceEstimate, Status
from .._values import stored_array

_MAX_DIRECTIONS, _EXPLAINED_VARIANCE = 100, 0.95
"""Largest number of principal directions, and the share of the variance that they explain."""
_THRESHOLD_QUANTILE = 0.995
"""Share of the held-out features whose distance is below the threshold, before `_MARGIN`."""
_MARGIN = 1.1
_LEAST = 1e-9
"""Smallest standard deviation along a direction."""
_CONTAINED = 0.9
"""Share of the held-out images that must lie in the initial network's distribution for it to be kept."""


@dataclass(frozen=True, eq=False)
class FeatureDistribution:
    """Gaussian of the training features in their principal directions, and isotropic in the residual.

    Attributes:
        centre: (d,) mean.
        directions: (d, k) principal directions.
        deviation: (k,) standard deviations along them.
        residual: root mean square of what is beside the directions.
        threshold: largest in-distribution distance.
        weight: share of the squared distance along the directions in the total; the rest is that beside them.
    """

    centre: FloatArray
    directions: FloatArray
    deviation: FloatArray
    residual: float
    threshold: float
    weight: float = 0.5

    def score(self, features: npt.NDArray[Any]) -> FloatArray:
        """Returns (n,) distances of ``features`` (n, d), over the threshold: up to 1 is in distribution."""
        centred = features.astype(np.float64) - self.centre
        along = centred @ self.directions
        beside = np.sum(centred * centred, axis=1) - np.sum(along * along, axis=1)
        within = np.mean((along / self.deviation) ** 2, axis=1)
        return np.sqrt(self.weight * within + (1.0 - self.weight) * beside / self.residual**2) / self.threshold

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Returns arrays for the model store."""
        return {
            "centre": self.centre.astype(np.float32),
            "directions": self.directions.astype(np.float32),
            "deviation": self.deviation.astype(np.float32),
            "scales": np.array([self.residual, self.threshold, self.weight]),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "FeatureDistribution":
        """The inverse of `arrays`. Raises KeyError where one is missing, ValueError where they do not fit."""
        centre = stored_array(arrays, "centre", (None,))
        directions = stored_array(arrays, "directions", (len(centre), None))
        deviation = stored_array(arrays, "deviation", (directions.shape[1],), low=_LEAST)
        scales = stored_array(arrays, "scales", (None,), low=0.0)
        found = cls(centre, directions, deviation, *scales.tolist())  # older models leave the weight out
        if not (found.residual > 0 and found.threshold > 0 and found.weight <= 1):
            raise ValueError("the scales of a distribution of features must be positive")
        return found


@dataclass(frozen=True, eq=False)
class OodDetector:
    """All feature distributions of a network, the newest first: its own, and those it was fine-tuned from."""

    distributions: tuple[FeatureDistribution, ...]

    def score(self, features: npt.NDArray[Any]) -> FloatArray:
        """Returns (n,) scores of ``features`` (n, d): up to 1 is in one distribution or another."""
        return np.min([each.score(features) for each in self.distributions], axis=0)

    def abstention(self, stamp_ns: int, features: npt.NDArray[Any]) -> ForceEstimate | None:
        """Returns an invalid estimate where ``features`` (1, d) are out of distribution, else None."""
        score = self.score(features)[0]
        if score <= 1.0:
            return None
        detail = f"the image is unlike the training images (out-of-distribution score {score:.1f}, the limit is 1)"
        return ForceEstimate.invalid(stamp_ns, Status.OUT_OF_DISTRIBUTION, detail)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Returns arrays for the model store."""
        return {
            f"ood{number}_{name}": values
            for number, each in enumerate(self.distributions)
            for name, values in each.arrays().items()
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "OodDetector":
        """The inverse of `arrays`. Raises KeyError where they hold no distribution."""
        found: list[FeatureDistribution] = []
        while not found or f"ood{len(found)}_centre" in arrays:
            prefix = f"ood{len(found)}_"
            found.append(
                FeatureDistribution.of(
                    {name: arrays[prefix + name] for name in ("centre", "directions", "deviation", "scales")}
                )
            )
        return cls(tuple(found))


def fit_ood_detector(
    training: npt.NDArray[Any],
    held_out: npt.NDArray[Any],
    threshold_features: npt.NDArray[Any],
    initial: OodDetector | None = None,
    *,
    ignored_directions: int | None = None,
) -> OodDetector:
    """Fit the distribution of the training features, beside those of the initial network that still hold.

    Args:
        training: (n, d) features of training images.
        held_out: (k, d) features of held-out images; an initial distribution is kept where it contains them.
        threshold_features: (m, d) features that set the threshold.
        initial: detector of the network that this one was fine-tuned from.
        ignored_directions: see `fit_feature_distribution`.
    """
    own = fit_feature_distribution(training, threshold_features, ignored_directions)
    kept: tuple[FeatureDistribution, ...] = ()
    if initial is not None and initial.distributions[0].centre.shape == own.centre.shape:
        kept = tuple(each for each in initial.distributions if np.mean(each.score(held_out) <= 1.0) >= _CONTAINED)
    return OodDetector((own, *kept))


def fit_feature_distribution(
    training: npt.NDArray[Any], held_out: npt.NDArray[Any], ignored_directions: int | None = None
) -> FeatureDistribution:
    """Fit the distribution of the features (n, d) of training images; (m, d) held-out ones set its threshold.

    Args:
        training: (n, d) features.
        held_out: (m, d) features.
        ignored_directions: only the residual beside so many principal directions counts, for features of which a few
            directions hold what is estimated.
    """
    features = training.astype(np.float64)
    centre = features.mean(axis=0)
    centred = features - centre
    values, vectors = np.linalg.eigh(centred.T @ centred / len(centred))
    values, vectors = values[::-1], vectors[:, ::-1]
    explaining = int(np.searchsorted(np.cumsum(values), _EXPLAINED_VARIANCE * values.sum())) + 1
    count = max(1, min(ignored_directions or explaining, _MAX_DIRECTIONS, len(centred) // 4, features.shape[1] - 1))
    directions, deviation = np.ascontiguousarray(vectors[:, :count]), np.sqrt(np.maximum(values[:count], 1e-12))
    residual = float(np.sqrt(max(values[count:].sum(), 1e-3 * values.sum())))
    weight = 0.5 if ignored_directions is None else 0.0
    found = FeatureDistribution(centre, directions, deviation, residual, 1.0, weight)
    return replace(found, threshold=_MARGIN * float(np.quantile(found.score(held_out), _THRESHOLD_QUANTILE)))
