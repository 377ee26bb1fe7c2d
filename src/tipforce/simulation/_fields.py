"""Kinds of numbers in settings of a simulated bench. A `Range` is (low, high): one uniform draw from it a session."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

__all__ = ["NotNegative", "Positive", "Range", "Settings", "Share"]


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"expected [low, high], got {list(bounds)}")
    return bounds


Range = Annotated[tuple[float, float], AfterValidator(_ordered)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class Settings(BaseModel):
    """Settings cannot be changed once made, and know all of their names."""

    model_config = ConfigDict(frozen=True, extra="forbid")
