"""Methods that are networks: trained by `learning`, run without what trained them."""

from ._graph import Graph
from ._network import MODEL, NetworkEstimator
from ._prepared import PREPARED
from ._settings import CompactSettings, DcfeSettings
from .compact import Compact
from .dcfe import Dcfe

__all__ = ["MODEL", "PREPARED", "Compact", "CompactSettings", "Dcfe", "DcfeSettings", "Graph", "NetworkEstimator"]
