"""Methods that are networks: trained by the package `training`, run on their ONNX graph without torch."""

from ._facts import NetworkFacts
from ._graph import Graph
from ._graph_file import check_graph_file
from ._network import GRAPH_FILE, NetworkEstimator
from ._preparation import PREPARED_FILE
from ._settings import CompactSettings, DcfeSettings, StereoSettings
from ._trial import try_graph
from .compact import Compact, CompactStream
from .dcfe import Dcfe
from .stereo import Stereo

__all__ = [
    "GRAPH_FILE",
    "PREPARED_FILE",
    "Compact",
    "CompactSettings",
    "CompactStream",
    "Dcfe",
    "DcfeSettings",
    "Graph",
    "NetworkEstimator",
    "NetworkFacts",
    "Stereo",
    "StereoSettings",
    "check_graph_file",
    "try_graph",
]
