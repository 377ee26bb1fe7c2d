"""Running trained networks, without what trained them."""

from ._graph import Graph

__all__ = ["Graph"]
