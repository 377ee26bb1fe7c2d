"""A network's own doubt: the variance it predicts, what its last layer was not taught, and how strange a picture is.

Last-layer Laplace approximation (MacKay 1992; Daxberger et al. 2021): with the features before the last dense layer
held fixed, the answer is linear in that layer's weights, and their posterior is a Gaussian. Pictures unlike all of the
training have features far from its own (Mahalanobis distance; Lee et al. 2018): they are refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["Doubt", "learn_doubt"]

_RIDGE = 1e-2
"""Of the features' mean variance, added to each: directions in which training never went are not infinitely strange."""
_PRIOR = 1.0
"""Precision of the last layer's weights before training, in those of one sample."""
_FAR = 0.999
"""Share of what was kept from training that lies nearer than the limit, before `_MARGIN`."""
_MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class Doubt:
    """``centre`` (k,) and ``whitening`` (k, k) of the features; ``untaught`` (k, k): root of the weights' covariance.

    ``far``: the largest distance that is answered, in root mean squares of the training's own.
    """

    centre: FloatArray
    whitening: FloatArray
    untaught: FloatArray
    far: float

    def distance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``features`` (n, k): 1 is usual."""
        moved = (features - self.centre) @ self.whitening
        return np.sqrt(np.mean(moved * moved, axis=-1))

    def variance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,): what the weights' doubt adds, as a share of the variance of one training sample's label."""
        moved = features @ self.untaught
        return np.sum(moved * moved, axis=-1)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        return {
            "doubt_centre": self.centre.astype(np.float32),
            "doubt_whitening": self.whitening.astype(np.float32),
            "doubt_untaught": self.untaught.astype(np.float32),
            "doubt_far": np.array(self.far),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "Doubt":
        """The inverse of `arrays`."""
        wide = {name: np.asarray(arrays[f"doubt_{name}"], np.float64) for name in ("centre", "whitening", "untaught")}
        return cls(**wide, far=float(arrays["doubt_far"]))


def learn_doubt(features: npt.NDArray[Any], kept: npt.NDArray[Any]) -> Doubt:
    """From the features (n, k) of the training part and those (m, k) of what was ``kept`` from it."""
    wide = np.asarray(features, np.float64)
    centre = wide.mean(axis=0)
    moved = wide - centre
    covariance = moved.T @ moved / len(moved)
    count = covariance.shape[0]
    values, vectors = np.linalg.eigh(covariance + _RIDGE * np.trace(covariance) / count * np.eye(count))
    whitening = vectors / np.sqrt(values)
    taught = wide.T @ wide + _PRIOR * np.eye(count)
    untaught = np.linalg.cholesky(np.linalg.inv(taught)).astype(np.float64)
    doubt = Doubt(centre, whitening, untaught, np.inf)
    limit = _MARGIN * float(np.quantile(doubt.distance(kept), _FAR))
    return Doubt(centre, whitening, untaught, limit)
