"""Training of networks on arrays: training loop, data augmentation, architectures, export and quantisation.

This is the only package that uses torch, which it imports when it is needed.
"""

from ._augmentation import Augmentation
from ._checkpoint import CHECKPOINT_FILE, LOG_FILE, duration_text
from ._compact import COMPACT_OUTPUTS, COMPACT_UNIT_N, TISSUE_N_PER_M, TISSUE_OUTPUTS, CompactTask, tissue_shares
from ._config import Batch, ClipNorm, Epochs, Rate, TrainConfig, WarmupEpochs, WeightDecay
from ._data import HEATMAP_UNKNOWN, TrainingSamples, TrainValSplit, train_val_split
from ._device import require_torch
from ._export import export_graph, graph_weights, parity_n, store_in_half_precision
from ._facts import TrainingFacts
from ._loop import Progress, TrainResult, train_network
from ._quantisation import MAX_ERROR_GROWTH, error_growth, quantise
from ._resnet import RESNET_OUTPUTS, ResnetTask
from ._stereo import STEREO_OUTPUTS, StereoTask
from ._task import Task, network_from_weights, network_weights

__all__ = [
    "CHECKPOINT_FILE",
    "COMPACT_OUTPUTS",
    "COMPACT_UNIT_N",
    "HEATMAP_UNKNOWN",
    "LOG_FILE",
    "MAX_ERROR_GROWTH",
    "RESNET_OUTPUTS",
    "STEREO_OUTPUTS",
    "TISSUE_N_PER_M",
    "TISSUE_OUTPUTS",
    "Augmentation",
    "Batch",
    "ClipNorm",
    "CompactTask",
    "Epochs",
    "Progress",
    "Rate",
    "ResnetTask",
    "StereoTask",
    "Task",
    "TrainConfig",
    "TrainResult",
    "TrainValSplit",
    "TrainingFacts",
    "TrainingSamples",
    "WarmupEpochs",
    "WeightDecay",
    "duration_text",
    "error_growth",
    "export_graph",
    "graph_weights",
    "network_from_weights",
    "network_weights",
    "parity_n",
    "quantise",
    "require_torch",
    "store_in_half_precision",
    "tissue_shares",
    "train_network",
    "train_val_split",
]
