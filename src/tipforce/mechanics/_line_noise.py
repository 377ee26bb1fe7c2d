"""Noise of a detected centreline: along the shaft, toward its base and at its tip."""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from typing import Any, Self

import numpy as np
from scipy.optimize import least_squares

from ..types import FloatArray


@dataclass(frozen=True, slots=True)
class LineNoise:
    """Error of a detected line: its displacement across itself, and the position of its end along itself.

    Across the line, at the arc length s of a length L, the standard deviation is the root of ``std_m``^2 +
    ``base_std_m``^2 exp(-s / ``base_m``) + ``tip_std_m``^2 exp(-(L - s) / ``tip_m``).

    Attributes:
        std_m: standard deviation far from both ends.
        correlation_m: length over which the rest of the variance is correlated: exp(-distance^2 / (2 length^2)).
        along_std_m: standard deviation of the tip's position along the line.
        base_std_m: additional standard deviation at the base.
        base_m: length over which it decreases.
        tip_std_m: additional standard deviation at the tip.
        tip_m: length over which it decreases.
        white_share: share of the variance that is independent from point to point.
        common_share: share of the variance that is the same all along.
    """

    std_m: float
    correlation_m: float
    along_std_m: float
    base_std_m: float = 0.0
    base_m: float = 5e-3
    tip_std_m: float = 0.0
    tip_m: float = 5e-3
    white_share: float = 0.01
    common_share: float = 0.0

    def __post_init__(self) -> None:
        lengths = (self.std_m, self.correlation_m, self.along_std_m, self.base_m, self.tip_m)
        ends = (self.base_std_m, self.tip_std_m)
        shares = self.white_share > 0 and self.common_share >= 0 and self.white_share + self.common_share <= 1
        if not (all(value > 0 for value in lengths) and all(value >= 0 for value in ends) and shares):
            raise ValueError(f"expected positive lengths and white_share, shares that add to 1 at most, got {self}")

    def std_at_m(self, arc_m: FloatArray) -> FloatArray:
        """Returns the standard deviation (points,) across the line, which begins and ends with ``arc_m`` (points,)."""
        from_base, from_tip = arc_m - arc_m[0], arc_m[-1] - arc_m
        base = self.base_std_m**2 * np.exp(-from_base / self.base_m)
        return np.sqrt(self.std_m**2 + base + self.tip_std_m**2 * np.exp(-from_tip / self.tip_m))

    def correlation(self, arc_m: FloatArray) -> FloatArray:
        """Returns the correlation (points, points) of the errors across the line at ``arc_m`` (points,)."""
        near = np.exp(-0.5 * ((arc_m[:, None] - arc_m) / self.correlation_m) ** 2)
        rest = 1.0 - self.white_share - self.common_share
        return self.white_share * np.eye(arc_m.size) + self.common_share + rest * near

    def covariance_m2(self, arc_m: FloatArray) -> FloatArray:
        """Returns the covariance (points + 1, points + 1): across the line at each point, then along it at the tip."""
        std, size = self.std_at_m(arc_m), arc_m.size
        out = np.zeros((size + 1, size + 1))
        out[:size, :size] = np.outer(std, std) * self.correlation(arc_m)
        out[size, size] = self.along_std_m**2
        return out

    @classmethod
    def fit(cls, covariance_m2: FloatArray, arc_m: FloatArray) -> Self:
        """Returns the noise whose covariance is nearest to a measured one.

        First the standard deviations are fitted by their logarithms, then the correlations, both by least squares.

        Args:
            covariance_m2: (points + 1, points + 1) in the form of `covariance_m2`.
            arc_m: (points,) arc lengths.
        """
        size = arc_m.size
        std = np.sqrt(np.diag(covariance_m2))
        middle = float(np.median(std[:size]))
        length = float(arc_m[-1] - arc_m[0])
        along = float(std[size])

        def spread(values: FloatArray) -> FloatArray:
            """Returns the differences of the standard deviations' logarithms."""
            shaft, base, tip, base_m, tip_m = np.exp(values).tolist()
            noise = cls(shaft, length, along, base, base_m, tip, tip_m)
            return np.log(noise.std_at_m(arc_m) / std[:size])

        low = np.log([0.1 * middle, 1e-3 * middle, 1e-3 * middle, 0.01 * length, 0.01 * length])
        high = np.log([3.0 * middle, 30.0 * middle, 100.0 * middle, 0.5 * length, 0.5 * length])
        start = np.log([0.8 * middle, 0.3 * middle, max(std[size - 1], middle), 0.1 * length, 0.1 * length])
        shaft, base, tip, base_m, tip_m = _fitted(spread, start, low, high)
        measured = covariance_m2[:size, :size] / np.outer(std[:size], std[:size])

        def related(values: FloatArray) -> FloatArray:
            """Returns the differences of the correlations."""
            correlation, white, common = np.exp(values).tolist()
            noise = cls(shaft, correlation, along, white_share=white, common_share=common)
            return (noise.correlation(arc_m) - measured).ravel()

        low = np.log([0.5 * length / size, 1e-3, 1e-4])
        high = np.log([length, 0.3, 0.69])
        correlation, white, common = _fitted(related, np.log([0.1 * length, 0.02, 0.1]), low, high)
        return cls(shaft, correlation, along, base, base_m, tip, tip_m, white, common)

    def scaled(self, factor: float) -> Self:
        """Returns the same noise with all lengths multiplied by ``factor``, for instance from pixels to metres.

        >>> LineNoise(0.03, 20.0, 0.5).scaled(2e-4).correlation_m
        0.004
        """
        names = [field.name for field in fields(self)]
        values = zip(names, astuple(self), strict=True)
        changed: dict[str, Any] = {name: value if name.endswith("share") else value * factor for name, value in values}
        return type(self)(**changed)


def _fitted(
    function: Callable[[FloatArray], FloatArray], start: FloatArray, low: FloatArray, high: FloatArray
) -> list[float]:
    """Returns exp(values) with the least squares of ``function(values)`` within the bounds, all as logarithms."""
    inner = 1e-6 * (high - low)
    found: Any = least_squares(function, np.clip(start, low + inner, high - inner), bounds=(low, high))
    return [math.exp(value) for value in found.x.tolist()]
