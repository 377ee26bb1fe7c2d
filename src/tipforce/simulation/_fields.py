"""Kinds of numbers in settings of a simulated bench. A `Range` is (low, high): one uniform draw from it a session."""

import math
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

_LARGEST = 1e9
"""No value of a bench is larger, in whatever unit."""


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"expected [low, high], got {list(bounds)}")
    return bounds


Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
Range = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
Positive = Annotated[float, Field(gt=0, le=_LARGEST)]
NotNegative = Annotated[float, Field(ge=0, le=_LARGEST)]
Share = Annotated[float, Field(ge=0, le=1)]
_Few = Annotated[int, Field(ge=0, le=100)]
Some = tuple[_Few, _Few]
"""(least, most) of what is drawn one by one."""


class Settings(BaseModel):
    """Settings cannot be changed once made, and know all of their names."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def standard_uncertainty(*errors: float) -> float | None:
    """Returns that of a uniform error that is ``errors`` at most, to three digits; None where these are 0.

    >>> standard_uncertainty(-0.01, 0.01)
    0.00577
    """
    largest = max(map(abs, errors))
    return float(f"{largest / math.sqrt(3.0):.3g}") if largest else None
