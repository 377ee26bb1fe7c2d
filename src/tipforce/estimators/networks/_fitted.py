"""The learnt state of a network."""

from collections.abc import Mapping
from dataclasses import dataclass

from ...types import BoolArray
from ..uncertainty import Interval
from ._facts import NetworkTraining
from ._graph import Graph
from ._preparation import Arrays


@dataclass(frozen=True, eq=False)
class FittedNetwork:
    """The learnt state of a network.

    Attributes:
        actuation: names of the actuation values among its inputs.
        actuation_limits: name -> smallest and largest value that it answers to, see `limits_of`.
        known: (3,) which force components it estimates.
        graph: the graph that is used.
        data: bytes of the graph in 32 bits.
        quantised: bytes of the graph in 8 bits, None without such a graph.
        log: the training log.
        arrays: further fitted arrays, see `NetworkEstimator.fit_arrays`.
        interval: conformal intervals.
        facts: facts of its training.
        sessions: all sessions it was trained on, with those of the model it was fine-tuned from.
    """

    actuation: tuple[str, ...]
    actuation_limits: Mapping[str, tuple[float, float]]
    known: BoolArray
    graph: Graph
    data: bytes
    quantised: bytes | None
    log: bytes
    arrays: Arrays
    interval: Interval
    facts: NetworkTraining
    sessions: tuple[str, ...]
