"""What a stored model of method 1 says, checked when it is loaded."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ..vision import ResolvedVision
from ._machine import Constants
from ._values import LARGEST

_Names = tuple[str, ...]
_Count = Annotated[int, Field(ge=0, lt=1 << 53)]
_Newtons = Annotated[float, Field(ge=0, le=LARGEST)]
_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class SvrState(BaseModel):
    """The values of `Svr.state` but the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: _Names
    actuation_limits: dict[str, tuple[_Number, _Number]] = {}
    shape: _Names
    known: tuple[bool, bool, bool]
    constants: tuple[Constants, ...]
    cv_rmse_n: tuple[_Newtons, ...]
    samples: _Count
    left_out: dict[str, list[_Count]]
    sessions: _Count
    vision: ResolvedVision | None
    parity_n: _Newtons
