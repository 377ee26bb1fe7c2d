"""Which pictures a network knows: those whose last grid of features lies near the grids it was trained on.

Places still count in that grid. Near is measured along the principal directions of the training's grids (Mahalanobis
distance; Lee et al. 2018) and beside all of them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["Domain", "learn_domain"]

_DIRECTIONS, _COVERED = 100, 0.95
"""Principal directions, at most, and the share of the variance that they need not exceed."""
_FAR = 0.995
"""Share of what was kept from training that lies nearer than the limit, before `_MARGIN`."""
_MARGIN = 1.1


@dataclass(frozen=True, eq=False)
class Domain:
    """``centre`` (d,), principal ``directions`` (d, k) and the grids' ``spread`` (k,) along them, ``rest`` beside them.

    ``rest`` is the root mean square of what is beside the directions. ``far``: the largest distance that is known.
    """

    centre: FloatArray
    directions: FloatArray
    spread: FloatArray
    rest: float
    far: float

    def distance(self, grids: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``grids`` (n, d): up to 1 is known."""
        moved = grids.astype(np.float64) - self.centre
        along = moved @ self.directions
        beside = np.sum(moved * moved, axis=1) - np.sum(along * along, axis=1)
        within = np.mean((along / self.spread) ** 2, axis=1)
        return np.sqrt(0.5 * (within + beside / self.rest**2)) / self.far

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        return {
            "centre": self.centre.astype(np.float32),
            "directions": self.directions.astype(np.float32),
            "spread": self.spread.astype(np.float32),
            "rest_far": np.array([self.rest, self.far]),
        }

    @classmethod
    def of(cls, arrays: dict[str, npt.NDArray[Any]]) -> "Domain":
        """The inverse of `arrays`."""
        centre, directions, spread = (
            np.asarray(arrays[name], np.float64) for name in ("centre", "directions", "spread")
        )
        return cls(centre, directions, spread, *(float(value) for value in arrays["rest_far"]))


def learn_domain(taught: npt.NDArray[Any], kept: npt.NDArray[Any]) -> Domain:
    """From the grids (n, d) of the training part, and those (m, d) of what was kept from it."""
    grids = taught.astype(np.float64)
    centre = grids.mean(axis=0)
    moved = grids - centre
    values, vectors = np.linalg.eigh(moved.T @ moved / len(moved))
    values, vectors = values[::-1], vectors[:, ::-1]
    covered = int(np.searchsorted(np.cumsum(values), _COVERED * values.sum())) + 1
    count = max(1, min(covered, _DIRECTIONS, len(moved) // 4))
    directions, spread = np.ascontiguousarray(vectors[:, :count]), np.sqrt(np.maximum(values[:count], 1e-12))
    rest = float(np.sqrt(max(values[count:].sum(), 1e-3 * values.sum())))
    domain = Domain(centre, directions, spread, rest, 1.0)
    return replace(domain, far=_MARGIN * float(np.quantile(domain.distance(kept), _FAR)))
