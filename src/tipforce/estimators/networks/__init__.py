"""Methods that are networks: trained by `learning`, run without what trained them."""

from ._graph import Graph
from ._network import NetworkEstimator
from ._settings import DcfeSettings
from .dcfe import Dcfe

__all__ = ["Dcfe", "DcfeSettings", "Graph", "NetworkEstimator"]
