"""Training of the locator, the network that finds the catheter in any image; it needs torch when it is imported."""

from ._export import GRAPH_OUTPUTS, export_locator, locator_from_graph
from ._inputs import NOMINAL_DIAMETER_PX, NOMINAL_LENGTH_PX, PROMPT_CHANNELS, network_input, prompt_channels
from ._loss import HEATMAP_SIGMA_CELLS, cosine_rate, linear_rate, locator_loss
from ._network import (
    LINE_POINTS,
    OBJECT_KINDS,
    POINT_STATES,
    SIZE_MULTIPLE_PX,
    STRIDE_PX,
    Encoder,
    Locator,
    LocatorOutputs,
    heat_peaks,
    read_checkpoint,
)

__all__ = [
    "GRAPH_OUTPUTS",
    "HEATMAP_SIGMA_CELLS",
    "LINE_POINTS",
    "NOMINAL_DIAMETER_PX",
    "NOMINAL_LENGTH_PX",
    "OBJECT_KINDS",
    "POINT_STATES",
    "PROMPT_CHANNELS",
    "SIZE_MULTIPLE_PX",
    "STRIDE_PX",
    "Encoder",
    "Locator",
    "LocatorOutputs",
    "cosine_rate",
    "export_locator",
    "heat_peaks",
    "linear_rate",
    "locator_from_graph",
    "locator_loss",
    "network_input",
    "prompt_channels",
    "read_checkpoint",
]
