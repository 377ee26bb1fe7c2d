"""Training of networks on arrays: the only room that knows torch, which it imports when it is used."""

from ._export import export_graph, parity_n, weights_of

__all__ = ["export_graph", "parity_n", "weights_of"]
