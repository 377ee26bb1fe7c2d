"""What a stored network says beside its graph, checked when it is loaded."""

from pydantic import BaseModel, ConfigDict

__all__ = ["NetworkState"]


class NetworkState(BaseModel):
    """The values of `NetworkEstimator.state` but the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: tuple[str, ...]
    known: tuple[bool, bool, bool]
    sessions: tuple[str, ...]
