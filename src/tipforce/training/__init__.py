"""Training of networks on arrays: the only room that knows torch, which it imports when it is used."""

from ._augment import Augmentation
from ._checkpoint import CHECKPOINT
from ._compact import COMPACT_UNIT_N, CompactTask
from ._compact_network import COMPACT_OUTPUTS
from ._export import export_graph, parity_n, weights_of
from ._log import LOG, duration
from ._loop import Progress, TrainResult, train_network
from ._machine import require_torch
from ._parts import Part, train_val_split
from ._quantise import LARGEST_GROWTH, error_growth, quantise
from ._recipe import TrainConfig
from ._resnet import RESNET_OUTPUTS, ResnetTask
from ._samples import UNKNOWN, Samples
from ._task import Task
from ._weights import network_of, weights_in

__all__ = [
    "CHECKPOINT",
    "COMPACT_OUTPUTS",
    "COMPACT_UNIT_N",
    "LARGEST_GROWTH",
    "LOG",
    "RESNET_OUTPUTS",
    "UNKNOWN",
    "Augmentation",
    "CompactTask",
    "Part",
    "Progress",
    "ResnetTask",
    "Samples",
    "Task",
    "TrainConfig",
    "TrainResult",
    "duration",
    "error_growth",
    "export_graph",
    "network_of",
    "parity_n",
    "quantise",
    "require_torch",
    "train_network",
    "train_val_split",
    "weights_in",
    "weights_of",
]
