"""What a stored model of method 1 says, checked when it is loaded."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ..vision import ResolvedVision
from ._machine import Constants

__all__ = ["SvrState"]

_Names = tuple[str, ...]
_Count = Annotated[int, Field(ge=0)]
_Newtons = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class SvrState(BaseModel):
    """The values of `Svr.state` but the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: _Names
    actuation_limits: tuple[tuple[_Finite, _Finite], ...] | None = None
    shape: _Names
    known: tuple[bool, bool, bool]
    constants: tuple[Constants, ...]
    cv_rmse_n: tuple[_Newtons, ...]
    samples: _Count
    left_out: dict[str, list[_Count]]
    sessions: _Count
    vision: ResolvedVision | None
    parity_n: _Newtons
