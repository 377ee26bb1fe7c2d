"""Which pictures a network knows: those whose features lie near the features of what it was trained on.

Near is measured along the principal directions of the training's features (Mahalanobis distance; Lee et al. 2018) and
beside all of them. A network that began with another's weights still knows what that one knew, as long as it sees its
new pictures as that one would.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, ForceEstimate, Status

__all__ = ["Domain", "Domains", "learn_domain", "learn_domains", "refused_as_strange"]

_DIRECTIONS, _COVERED = 100, 0.95
"""Principal directions, at most, and the share of the variance that they need not exceed."""
_FAR = 0.995
"""Share of what was kept from training that lies nearer than the limit, before `_MARGIN`."""
_MARGIN = 1.1
_ALIKE = 0.9
"""Share of the new pictures that must lie in a domain from before, for it to count still."""


@dataclass(frozen=True, eq=False)
class Domain:
    """``centre`` (d,), principal ``directions`` (d, k), the features' ``spread`` (k,) along and ``rest`` beside them.

    ``rest`` is the root mean square of what is beside the directions. ``far``: the largest distance that is known.
    ``weight``: the share that what is along the directions has in the distance; the rest is of what is beside them.
    """

    centre: FloatArray
    directions: FloatArray
    spread: FloatArray
    rest: float
    far: float
    weight: float = 0.5

    def distance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``features`` (n, d): up to 1 is known."""
        moved = features.astype(np.float64) - self.centre
        along = moved @ self.directions
        beside = np.sum(moved * moved, axis=1) - np.sum(along * along, axis=1)
        within = np.mean((along / self.spread) ** 2, axis=1)
        return np.sqrt(self.weight * within + (1.0 - self.weight) * beside / self.rest**2) / self.far

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        return {
            "centre": self.centre.astype(np.float32),
            "directions": self.directions.astype(np.float32),
            "spread": self.spread.astype(np.float32),
            "rest_far": np.array([self.rest, self.far, self.weight]),
        }

    @classmethod
    def of(cls, arrays: dict[str, npt.NDArray[Any]]) -> "Domain":
        """The inverse of `arrays`."""
        centre, directions, spread = (
            np.asarray(arrays[name], np.float64) for name in ("centre", "directions", "spread")
        )
        return cls(centre, directions, spread, *(float(value) for value in arrays["rest_far"]))


@dataclass(frozen=True, eq=False)
class Domains:
    """All that a network knows, ``each`` domain by itself, the newest first."""

    each: tuple[Domain, ...]

    def distance(self, features: npt.NDArray[Any]) -> FloatArray:
        """(n,) of ``features`` (n, d): up to 1 is known, by one domain or another."""
        return np.min([domain.distance(features) for domain in self.each], axis=0)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For the model store."""
        return {
            f"domain{place}_{name}": values
            for place, domain in enumerate(self.each)
            for name, values in domain.arrays().items()
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> "Domains":
        """The inverse of `arrays`. Raises KeyError where they hold none."""
        found: list[Domain] = []
        while not found or f"domain{len(found)}_centre" in arrays:
            begin = f"domain{len(found)}_"
            found.append(
                Domain.of({name: arrays[begin + name] for name in ("centre", "directions", "spread", "rest_far")})
            )
        return cls(tuple(found))


def learn_domains(
    taught: npt.NDArray[Any],
    kept: npt.NDArray[Any],
    limiting: npt.NDArray[Any],
    start: Domains | None = None,
    *,
    beside: int | None = None,
) -> Domains:
    """One more domain, from the features ``taught`` (n, d) and ``limiting`` (m, d), and those of ``start`` that count.

    ``start``: of the network that this one began with; they count where they know the ``kept`` (k, d) pictures, too.
    ``beside``: see `learn_domain`.
    """
    own = learn_domain(taught, limiting, beside)
    before: tuple[Domain, ...] = ()
    if start is not None and start.each[0].centre.shape == own.centre.shape:
        before = tuple(each for each in start.each if np.mean(each.distance(kept) <= 1.0) >= _ALIKE)
    return Domains((own, *before))


def refused_as_strange(stamp_ns: int, domains: Domains, features: npt.NDArray[Any]) -> ForceEstimate | None:
    """Not valid, where ``features`` (1, d) lie outside ``domains``."""
    far = domains.distance(features)[0]
    if far <= 1.0:
        return None
    said = f"the picture is unlike those it learnt from ({far:.1f} times as far)"
    return ForceEstimate.invalid(stamp_ns, Status.OUT_OF_DOMAIN, said)


def learn_domain(taught: npt.NDArray[Any], kept: npt.NDArray[Any], beside: int | None = None) -> Domain:
    """From the features (n, d) of the training part, and those (m, d) of what was kept from it.

    ``beside``: only what is beside so many directions counts, for features of which a few say what is to be answered.
    """
    features = taught.astype(np.float64)
    centre = features.mean(axis=0)
    moved = features - centre
    values, vectors = np.linalg.eigh(moved.T @ moved / len(moved))
    values, vectors = values[::-1], vectors[:, ::-1]
    covered = int(np.searchsorted(np.cumsum(values), _COVERED * values.sum())) + 1
    count = max(1, min(beside or covered, _DIRECTIONS, len(moved) // 4, features.shape[1] - 1))
    directions, spread = np.ascontiguousarray(vectors[:, :count]), np.sqrt(np.maximum(values[:count], 1e-12))
    rest = float(np.sqrt(max(values[count:].sum(), 1e-3 * values.sum())))
    domain = Domain(centre, directions, spread, rest, 1.0, 0.5 if beside is None else 0.0)
    return replace(domain, far=_MARGIN * float(np.quantile(domain.distance(kept), _FAR)))
