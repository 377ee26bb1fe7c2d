"""The stored values of a network beside its graph, checked when they are loaded."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from .._values import LARGEST

_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class NetworkState(BaseModel):
    """The values of `NetworkEstimator.state` but the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: tuple[str, ...]
    actuation_limits: dict[str, tuple[_Number, _Number]] = {}
    """Empty in models that were saved before limits existed."""
    known: tuple[bool, bool, bool]
    sessions: tuple[str, ...]
