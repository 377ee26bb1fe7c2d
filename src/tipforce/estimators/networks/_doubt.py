"""A network's own doubt: the variance it predicts, what its last layer was not taught, and how strange a picture is.

Last-layer Laplace approximation (MacKay 1992; Daxberger et al. 2021): with the features before the last dense layer
held fixed, the answer is linear in that layer's weights, and their posterior is a Gaussian. Pictures unlike all of the
training are refused: their last grid of features, where places still count, lies far from the training's, along its
principal directions (Mahalanobis distance; Lee et al. 2018) or beside all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["Doubt", "learn_doubt"]

_DIRECTIONS, _COVERED = 100, 0.95
"""Principal directions, at most, and the share of the variance that they need not exceed."""
_PRIOR = 1.0
"""Precision of the last layer's weights before training, in those of one sample."""
_FAR = 0.995
"""Share of what was kept from training that lies nearer than the limit, before `_MARGIN`."""
_MARGIN = 1.1


@dataclass(frozen=True, eq=False)
class Doubt:
    """``centre`` (d,), principal ``directions`` (d, k) and the grids' ``spread`` (k,) along them, ``rest`` beside them.

    ``rest`` is the root mean square of what is beside the directions. ``untaught`` (f, f): root of the covariance of
    the last layer's weights. ``far``: the largest distance that is answered.
    """

    centre: FloatArray
    directions: FloatArray
    spread: FloatArray
    rest: float
    untaught: FloatArray
    far: float

    def distance(self, grids: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``grids`` (n, d): about 1 is usual."""
        moved = grids - self.centre
        along = moved @ self.directions
        beside = np.sum(moved * moved, axis=1) - np.sum(along * along, axis=1)
        within = np.mean((along / self.spread) ** 2, axis=1)
        return np.sqrt(0.5 * (within + beside / self.rest**2))

    def variance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,): what the weights' doubt adds, as a share of the variance of one training sample's label."""
        moved = features @ self.untaught
        return np.sum(moved * moved, axis=-1)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        wide = {name: getattr(self, name).astype(np.float32) for name in ("centre", "directions", "spread", "untaught")}
        numbers = {"rest": np.array(self.rest), "far": np.array(self.far)}
        return {f"doubt_{name}": values for name, values in (wide | numbers).items()}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "Doubt":
        """The inverse of `arrays`."""
        names = ("centre", "directions", "spread", "untaught")
        wide = {name: np.asarray(arrays[f"doubt_{name}"], np.float64) for name in names}
        return cls(**wide, rest=float(arrays["doubt_rest"]), far=float(arrays["doubt_far"]))


def learn_doubt(taught: Mapping[str, npt.NDArray[Any]], kept_grids: npt.NDArray[Any]) -> Doubt:
    """From the outputs "grid" (n, d) and "features" (n, f) of the training part, and grids (m, d) kept from it."""
    grids, features = (np.asarray(taught[name], np.float64) for name in ("grid", "features"))
    centre = grids.mean(axis=0)
    moved = grids - centre
    values, vectors = np.linalg.eigh(moved.T @ moved / len(moved))
    values, vectors = values[::-1], vectors[:, ::-1]
    covered = int(np.searchsorted(np.cumsum(values), _COVERED * values.sum())) + 1
    count = max(1, min(covered, _DIRECTIONS, len(moved) // 4))
    directions, spread = np.ascontiguousarray(vectors[:, :count]), np.sqrt(np.maximum(values[:count], 1e-12))
    rest = float(np.sqrt(max(values[count:].sum(), 1e-3 * values.sum())))
    taught_weights = features.T @ features + _PRIOR * np.eye(features.shape[1])
    untaught = np.linalg.cholesky(np.linalg.inv(taught_weights)).astype(np.float64)
    doubt = Doubt(centre, directions, spread, rest, untaught, np.inf)
    return replace(doubt, far=_MARGIN * float(np.quantile(doubt.distance(kept_grids), _FAR)))
