"""Kinds of numbers in settings of a simulated bench. A `Range` is (low, high): one uniform draw from it a session."""

import math
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

MAX_VALUE = 1e9
"""Largest value of any quantity of a bench, in any unit."""


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"expected [low, high], got {list(bounds)}")
    return bounds


Number = Annotated[float, Field(ge=-MAX_VALUE, le=MAX_VALUE)]
Range = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
Positive = Annotated[float, Field(gt=0, le=MAX_VALUE)]
NotNegative = Annotated[float, Field(ge=0, le=MAX_VALUE)]
Share = Annotated[float, Field(ge=0, le=1)]
_Few = Annotated[int, Field(ge=0, le=100)]
Some = tuple[_Few, _Few]
"""Smallest and largest number of objects that are drawn one by one."""


class Settings(BaseModel):
    """Settings are frozen; an unknown name is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def standard_uncertainty(*errors: float) -> float | None:
    """Returns the standard uncertainty of a uniform error of at most ``errors``, to three digits; None if these are 0.

    >>> standard_uncertainty(-0.01, 0.01)
    0.00577
    """
    largest = max(map(abs, errors))
    return float(f"{largest / math.sqrt(3.0):.3g}") if largest else None
