"""A network's own doubt: what its last layer was not taught, and how strange a picture is.

Last-layer Laplace approximation (MacKay 1992; Daxberger et al. 2021): with the features before the last dense layer
held fixed, the answer is linear in that layer's weights, and their posterior is a Gaussian. Pictures whose last grid of
features, in which places still count, is unlike all of the training's are refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from ._domain import Domains, learn_domains

__all__ = ["Doubt", "learn_doubt"]

_PRIOR = 1.0
"""Precision of the last layer's weights before training, in those of one sample."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """``domains``: which grids are known. ``untaught`` (f, f): root of the last weights' covariance."""

    domains: Domains
    untaught: FloatArray

    def variance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,): what the weights' doubt adds, as a share of the variance of one training sample's label."""
        moved = features @ self.untaught
        return np.sum(moved * moved, axis=-1)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        return {**self.domains.arrays(), "doubt_untaught": self.untaught.astype(np.float32)}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "Doubt":
        """The inverse of `arrays`. Raises KeyError where they hold none."""
        return cls(Domains.of(arrays), np.asarray(arrays["doubt_untaught"], np.float64))


def learn_doubt(
    taught: Mapping[str, npt.NDArray[Any]],
    kept: Mapping[str, npt.NDArray[Any]],
    altered_grids: npt.NDArray[Any],
    start: Doubt | None = None,
) -> Doubt:
    """From the outputs "grid" (n, d) and "features" (n, f) of the training part, and of what was ``kept`` from it.

    ``altered_grids`` (m, d): of the kept ones, altered as in training. ``start``: the doubt of the network that this
    one began with; what it knew counts where it knows the kept pictures, too.
    """
    domains = learn_domains(taught["grid"], kept["grid"], altered_grids, None if start is None else start.domains)
    features = taught["features"].astype(np.float64)
    precision = features.T @ features + _PRIOR * np.eye(features.shape[1])
    if start is not None and len(domains.each) > 1:
        precision += np.linalg.inv(start.untaught @ start.untaught.T)
    untaught = np.linalg.cholesky(np.linalg.inv(precision)).astype(np.float64)
    return Doubt(domains, untaught)
