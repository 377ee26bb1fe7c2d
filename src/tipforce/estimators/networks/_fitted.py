"""The learnt state of a network."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, InstanceOf

from .._values import Known, Number
from ..uncertainty import StoredInterval
from ._facts import NetworkTraining
from ._graph import Graph


class FittedNetwork(BaseModel):
    """The learnt state of a network.

    Attributes:
        actuation: names of the actuation values among its inputs.
        actuation_limits: name -> smallest and largest value that it answers to, see `limits_of`; empty in models that
            were saved before these were known.
        known: (3,) which force components it estimates.
        interval: conformal intervals.
        facts: facts of its training.
        sessions: all sessions it was trained on, with those of the model it was fine-tuned from.
        graph: the graph that is used.
        data: bytes of the graph in 32 bits.
        quantised: bytes of the graph in 8 bits, None without such a graph.
        log: the training log.
        arrays: further fitted arrays, see `NetworkEstimator.fit_arrays`.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: tuple[str, ...]
    actuation_limits: dict[str, tuple[Number, Number]] = {}
    known: Known
    interval: StoredInterval
    facts: NetworkTraining
    sessions: tuple[str, ...]
    graph: Annotated[InstanceOf[Graph], Field(exclude=True)]
    data: Annotated[bytes, Field(exclude=True)]
    quantised: Annotated[bytes | None, Field(exclude=True)]
    log: Annotated[bytes, Field(exclude=True)]
    arrays: Annotated[Any, Field(exclude=True)]
