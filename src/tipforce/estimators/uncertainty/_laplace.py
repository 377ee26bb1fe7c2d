"""Epistemic uncertainty of a network: Laplace approximation of its last layer (MacKay 1992; Daxberger et al. 2021).

The features before the last dense layer are kept fixed, so the output is linear in the weights of that layer, and their
posterior is a Gaussian.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from .._values import stored_array

PRIOR_PRECISION = 1.0
"""Precision of the last layer's weights before training, in units of one sample's."""


@dataclass(frozen=True, eq=False)
class LastLayerLaplace:
    """Posterior of the last layer's weights; ``root_covariance`` (f, f): root of their covariance."""

    root_covariance: FloatArray

    def variance(self, features: npt.NDArray[Any]) -> FloatArray:
        """Returns (n,) epistemic variances for ``features`` (n, f), over the variance of a training sample's label."""
        projected = features @ self.root_covariance
        return np.sum(projected * projected, axis=-1)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Returns arrays for the model store."""
        return {"laplace_root_covariance": self.root_covariance.astype(np.float32)}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "LastLayerLaplace":
        """Makes the posterior from the return value of `arrays`.

        Raises:
            KeyError: the array is missing.
            ValueError: it is no square matrix.
        """
        root = stored_array(arrays, "laplace_root_covariance", (None, None))
        if root.shape[0] != root.shape[1]:
            raise ValueError(f"laplace_root_covariance has the shape {root.shape}, expected a square")
        return cls(root)


def fit_laplace(features: npt.NDArray[Any], initial: LastLayerLaplace | None = None) -> LastLayerLaplace:
    """Returns the posterior of the last layer's weights.

    Args:
        features: (n, f) features of training images.
        initial: posterior of the network that this one was fine-tuned from, whose samples count, too.
    """
    features = features.astype(np.float64)
    # in units of the precision of one sample's label
    precision = features.T @ features + PRIOR_PRECISION * np.eye(features.shape[1])
    if initial is not None:
        precision += np.linalg.inv(initial.root_covariance @ initial.root_covariance.T)
    return LastLayerLaplace(np.linalg.cholesky(np.linalg.inv(precision)).astype(np.float64))
