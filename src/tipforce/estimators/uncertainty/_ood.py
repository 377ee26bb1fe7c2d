"""Out-of-distribution detection: images whose features are far from the features of the training images.

The distance is measured along the principal directions of the training features (Mahalanobis distance; Lee et al. 2018)
and in the residual orthogonal to them. A fine-tuned network keeps the distributions of its initial network, as
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
"""Share of the held-out features whose distance is below the threshold, before `THRESHOLD_MARGIN`."""
THRESHOLD_MARGIN = 1.1
_LEAST_RESIDUAL_SHARE = 1e-3
"""Smallest share of the residual in the variance: training features may have next to none."""
MIN_DEVIATION = 1e-9
"""Smallest standard deviation along a direction."""
MIN_CONTAINED_SHARE = 0.9
"""An initial distribution is kept if it contains at least this share of the held-out images."""


@dataclass(frozen=True, eq=False)
class FeatureDistribution:
    """Gaussian of the training features in their principal directions, and isotropic in the residual.

    Attributes:
        centre: (d,) mean.
        directions: (d, k) principal directions.
        deviation: (k,) standard deviations along them.
        residual: root mean square of the component that is orthogonal to the directions.
        threshold: largest in-distribution distance.
        weight: share of the squared distance along the directions in the total; the rest is the residual.
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
        along2 = np.mean((along / self.deviation) ** 2, axis=1)
        orthogonal2 = np.sum(centred * centred, axis=1) - np.sum(along * along, axis=1)  # by Pythagoras
        return np.sqrt(self.weight * along2 + (1.0 - self.weight) * orthogonal2 / self.residual**2) / self.threshold

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
        """Makes the distribution from the return value of `arrays`.

        Raises:
            KeyError: an array is missing.
            ValueError: the arrays do not fit each other.
        """
        centre = stored_array(arrays, "centre", (None,))
        directions = stored_array(arrays, "directions", (len(centre), None))
        deviation = stored_array(arrays, "deviation", (directions.shape[1],), low=MIN_DEVIATION)
        scales = stored_array(arrays, "scales", (None,), low=0.0)
        made = cls(centre, directions, deviation, *scales.tolist())  # older models leave the weight out
        if not (made.residual > 0 and made.threshold > 0 and made.weight <= 1):
            raise ValueError("the scales of a distribution of features must be positive")
        return made


@dataclass(frozen=True, eq=False)
class OodDetector:
    """All feature distributions of a network, the newest first: its own, and those it was fine-tuned from."""

    distributions: tuple[FeatureDistribution, ...]

    def score(self, features: npt.NDArray[Any]) -> FloatArray:
        """Returns (n,) scores of ``features`` (n, d): up to 1 is in one of the distributions."""
        return np.min([each.score(features) for each in self.distributions], axis=0)

    def abstention(self, stamp_ns: int, features: npt.NDArray[Any]) -> ForceEstimate | None:
        """Returns an invalid estimate where an image is out of distribution, else None.

        Args:
            stamp_ns: stamp of the image.
            features: (1, d) its features.
        """
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
        """Makes the detector from the return value of `arrays`. Raises KeyError without any distribution."""
        distributions: list[FeatureDistribution] = []
        while not distributions or f"ood{len(distributions)}_centre" in arrays:
            names = ("centre", "directions", "deviation", "scales")
            stored = {name: arrays[f"ood{len(distributions)}_{name}"] for name in names}
            distributions.append(FeatureDistribution.of(stored))
        return cls(tuple(distributions))


def fit_ood_detector(
    training: npt.NDArray[Any],
    held_out: npt.NDArray[Any],
    threshold_features: npt.NDArray[Any],
    initial: OodDetector | None = None,
    *,
    ignored_directions: int | None = None,
) -> OodDetector:
    """Fits the distribution of the training features, and keeps those of the initial network that still hold.

    Args:
        training: (n, d) features of training images.
        held_out: (k, d) features of held-out images; an initial distribution is kept where it contains them.
        threshold_features: (m, d) features that set the threshold.
        initial: detector of the network that this one was fine-tuned from.
        ignored_directions: see `fit_feature_distribution`.

    Returns:
        The detector; its first distribution is that of ``training``.
    """
    newest = fit_feature_distribution(training, threshold_features, ignored_directions)
    kept: tuple[FeatureDistribution, ...] = ()
    if initial is not None and initial.distributions[0].centre.shape == newest.centre.shape:
        kept = tuple(
            each for each in initial.distributions if np.mean(each.score(held_out) <= 1.0) >= MIN_CONTAINED_SHARE
        )
    return OodDetector((newest, *kept))


def fit_feature_distribution(
    training: npt.NDArray[Any], held_out: npt.NDArray[Any], ignored_directions: int | None = None
) -> FeatureDistribution:
    """Fits the distribution of the features of training images.

    Args:
        training: (n, d) features of training images.
        held_out: (m, d) features of held-out images, which set the threshold.
        ignored_directions: number of principal directions that are ignored, so that only the residual counts; for
            features that hold the estimated number in a few directions.

    Returns:
        The distribution with its threshold.
    """
    features = training.astype(np.float64)
    centre = features.mean(axis=0)
    centred = features - centre
    variances, vectors = np.linalg.eigh(centred.T @ centred / len(centred))
    variances, vectors = variances[::-1], vectors[:, ::-1]  # the largest first
    explaining = int(np.searchsorted(np.cumsum(variances), _EXPLAINED_VARIANCE * variances.sum())) + 1
    # a quarter of the samples: more directions cannot be estimated; one dimension at least is left for the residual
    count = max(1, min(ignored_directions or explaining, _MAX_DIRECTIONS, len(centred) // 4, features.shape[1] - 1))
    directions, deviation = np.ascontiguousarray(vectors[:, :count]), np.sqrt(np.maximum(variances[:count], 1e-12))
    residual = float(np.sqrt(max(variances[count:].sum(), _LEAST_RESIDUAL_SHARE * variances.sum())))
    weight = 0.5 if ignored_directions is None else 0.0
    made = FeatureDistribution(centre, directions, deviation, residual, 1.0, weight)
    return replace(made, threshold=THRESHOLD_MARGIN * float(np.quantile(made.score(held_out), _THRESHOLD_QUANTILE)))
