"""A network's own doubt: what its last layer was not taught, and how strange a picture is.

Last-layer Laplace approximation (MacKay 1992; Daxberger et al. 2021): with the features before the last dense layer
held fixed, the answer is linear in that layer's weights, and their posterior is a Gaussian. Pictures unlike all of the
training are refused. A network that began with another's weights still knows what that one knew, as long as it sees
its new pictures as that one would.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from ._domain import Domain, learn_domain

__all__ = ["Doubt", "learn_doubt"]

_PRIOR = 1.0
"""Precision of the last layer's weights before training, in those of one sample."""
_ALIKE = 0.9
"""Share of the new pictures that must lie in a domain from before, for it to count still."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """``domains``: what is known, newest first. ``untaught`` (f, f): root of the last weights' covariance."""

    domains: tuple[Domain, ...]
    untaught: FloatArray

    def distance(self, grids: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``grids`` (n, d): up to 1 is known, by one domain or another."""
        return np.min([domain.distance(grids) for domain in self.domains], axis=0)

    def variance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,): what the weights' doubt adds, as a share of the variance of one training sample's label."""
        moved = features @ self.untaught
        return np.sum(moved * moved, axis=-1)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        made = {
            f"domain{place}_{name}": values
            for place, domain in enumerate(self.domains)
            for name, values in domain.arrays().items()
        }
        return {**made, "doubt_untaught": self.untaught.astype(np.float32)}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "Doubt":
        """The inverse of `arrays`. Raises KeyError where they hold none."""
        domains: list[Domain] = []
        while not domains or f"domain{len(domains)}_centre" in arrays:
            begin = f"domain{len(domains)}_"
            domains.append(
                Domain.of({name: arrays[begin + name] for name in ("centre", "directions", "spread", "rest_far")})
            )
        return cls(tuple(domains), np.asarray(arrays["doubt_untaught"], np.float64))


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
    own = learn_domain(taught["grid"], altered_grids)
    features = taught["features"].astype(np.float64)
    precision = features.T @ features + _PRIOR * np.eye(features.shape[1])
    before: tuple[Domain, ...] = ()
    if start is not None and start.domains[0].centre.shape == own.centre.shape:
        before = tuple(each for each in start.domains if np.mean(each.distance(kept["grid"]) <= 1.0) >= _ALIKE)
    if start is not None and before:
        precision += np.linalg.inv(start.untaught @ start.untaught.T)
    untaught = np.linalg.cholesky(np.linalg.inv(precision)).astype(np.float64)
    return Doubt((own, *before), untaught)
