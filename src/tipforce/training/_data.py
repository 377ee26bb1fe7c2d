"""Labelled samples for a network, and their split into training and validation."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .._system.rows import evenly_spread
from ..errors import InputError
from ..types import IntArray
from ._config import TrainConfig

HEATMAP_UNKNOWN = 255
"""Value of every pixel of an unknown heatmap. A catheter never fills its image, so it is unambiguous."""

_FINGERPRINT_IMAGES = 16


@dataclass(frozen=True, eq=False)
class TrainingSamples:
    """Labelled images with the other inputs of the network.

    Attributes:
        images: (n, h, w[, 3]) uint8, with several views (n, views, h, w); may be a memory map.
        force_n: (n, t) force components in newtons.
        session: (n,) name of each sample's session.
        inputs: name -> (n, k) further inputs of the network.
        heatmap: (n, [views,] hh, ww) uint8, the position of the catheter; `HEATMAP_UNKNOWN` in all pixels where
            unknown. None where no sample has one.

    Raises:
        ValueError: the arrays differ in length.
    """

    images: npt.NDArray[np.uint8]
    force_n: npt.NDArray[np.float32]
    session: npt.NDArray[np.str_]
    inputs: Mapping[str, npt.NDArray[np.float32]] = field(default_factory=dict[str, npt.NDArray[np.float32]])
    heatmap: npt.NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        lengths = {"images": len(self.images), "force_n": len(self.force_n), "session": len(self.session)}
        lengths |= {name: len(values) for name, values in self.inputs.items()}
        lengths |= {} if self.heatmap is None else {"heatmap": len(self.heatmap)}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"samples: expected arrays of one length, got {lengths}")

    def __len__(self) -> int:
        return len(self.force_n)

    def fingerprint(self) -> str:
        """Returns the SHA-256 of all labels and inputs and of some images, spread evenly over all."""
        digest = hashlib.sha256(repr((self.images.shape, sorted(self.inputs))).encode())
        for array in (self.force_n, *(self.inputs[name] for name in sorted(self.inputs))):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update("\n".join(self.session.tolist()).encode())
        for index in evenly_spread(len(self), _FINGERPRINT_IMAGES).tolist():
            digest.update(self.images[index].tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class TrainValSplit:
    """Ascending indices of the samples for training and of those for validation.

    Attributes:
        train: indices of the training split.
        val: indices of the validation split.
        by_session: True where the validation split consists of whole sessions.
    """

    train: IntArray
    val: IntArray
    by_session: bool


def train_val_split(session: npt.NDArray[np.str_], config: TrainConfig) -> TrainValSplit:
    """Draws the validation split at random.

    Args:
        session: (n,) name of each sample's session.
        config: its ``validation``, ``hold_out`` and ``seed`` determine the split; ``validation`` 0: all samples train.

    Returns:
        Sorted indices of the samples of both parts, and whether whole sessions are held out.

    Raises:
        InputError: there are too few sessions or samples.

    >>> split = train_val_split(np.repeat([f"s{k}" for k in range(10)], 3), TrainConfig())
    >>> len(split.train), len(split.val), split.by_session
    (27, 3, True)
    """
    if config.validation == 0:
        return TrainValSplit(np.arange(len(session)), np.empty(0, np.int64), by_session=False)
    names = list(dict.fromkeys(session.tolist()))
    rng = np.random.default_rng((config.seed, 0))
    count = int(config.validation * len(names) + 1e-9)
    by_session = config.hold_out == "session" or (config.hold_out == "auto" and count >= 1)
    if by_session:
        count = max(1, count)
        if len(names) < 2:
            raise InputError("hold_out=session needs at least two sessions, got one; leave it at auto")
        held_out = np.isin(session, [names[index] for index in rng.permutation(len(names))[:count]])
    else:
        held_out = np.zeros(len(session), np.bool_)
        held_out[rng.permutation(len(session))[: max(1, round(config.validation * len(session)))]] = True
    if np.count_nonzero(~held_out) < 2:
        raise InputError(f"{len(session)} samples are too few to train on and to hold some out for validation")
    return TrainValSplit(np.flatnonzero(~held_out), np.flatnonzero(held_out), by_session)
