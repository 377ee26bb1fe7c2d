"""The saved values of a shape regressor, checked when it is loaded."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from ...vision import ResolvedVision
from .._values import LARGEST

_Count = Annotated[int, Field(ge=0, lt=1 << 53)]
_Newtons = Annotated[float, Field(ge=0, le=LARGEST)]
_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class ShapeState(BaseModel):
    """The values of `ShapeRegressor.state` except for the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: tuple[str, ...]
    actuation_limits: dict[str, tuple[_Number, _Number]] = {}
    shape: tuple[str, ...]
    known: tuple[bool, bool, bool]
    cv_rmse_n: tuple[_Newtons, ...]
    samples: _Count
    left_out: dict[str, list[_Count]]
    sessions: _Count
    vision: ResolvedVision | None
    model: dict[str, Any] = {}
    """Values of the method's own."""
