"""Reads one image with the network: as the ONNX graph is used, for judging a network while it is trained."""

import math
from typing import NamedTuple

import cv2
import numpy as np
import torch

from ...types import FloatArray, Image, IntArray
from ._inputs import network_input, prompt_channels
from ._network import SIZE_MULTIPLE_PX, Locator, heat_peaks


class LocatedPoints(NamedTuple):
    """Points of the catheter in an image.

    Attributes:
        points_px: (LINE_POINTS, 2) u, v px of the image, base to tip.
        mass: (LINE_POINTS,) probability that the point is within a cell of its peak.
        states: (LINE_POINTS,) most probable states.
        present: probability of a catheter in the image.
    """

    points_px: FloatArray
    mass: FloatArray
    states: IntArray
    present: float


@torch.inference_mode()
def locate_points(
    network: Locator,
    image: Image,
    scale: float,
    *,
    base: tuple[float, float] | None = None,
    side: int | None = None,
    sizes: tuple[float, float] | None = None,
) -> LocatedPoints:
    """Returns the points that the network finds in an image.

    Args:
        network: the locator, in eval mode.
        image: (h, w, 3) RGB.
        scale: px of the network's image for each px of ``image``; the catheter is best some 110 px long there.
        base: u, v px of a click on the base.
        side: index in SIDES of the border that the catheter comes from.
        sizes: length and diameter in px; NaN for one that is not known.
    """
    interpolation = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=interpolation)
    h, w = small.shape[:2]
    padded = cv2.copyMakeBorder(small, 0, -h % SIZE_MULTIPLE_PX, 0, -w % SIZE_MULTIPLE_PX, cv2.BORDER_REPLICATE)

    def stated(values: tuple[float, ...] | None, count: int, factor: float = 1.0, offset: float = 0.0) -> torch.Tensor:
        row = [math.nan] * count if values is None else [value * factor + offset for value in values]
        return torch.tensor([row], dtype=torch.float32)

    channels = prompt_channels(
        (padded.shape[0], padded.shape[1]), stated(base, 2, scale, 0.5 * (scale - 1.0)), stated(None, 4),
        stated(None if side is None else (float(side),), 1), stated(None, 2), torch.full((1, 1, 2), math.nan),
        torch.full((1, 2, 2), math.nan), stated(sizes, 2, scale),
    )  # fmt: skip
    x = network_input(torch.from_numpy(np.asarray(padded, np.uint8))[None], channels)
    outputs = network(x.contiguous(memory_format=torch.channels_last))
    points, mass = heat_peaks(outputs.heat)
    return LocatedPoints(
        (points[0].numpy().astype(np.float64) + 0.5) / scale - 0.5,
        mass[0].numpy().astype(np.float64),
        outputs.states[0].argmax(-1).numpy(),
        float(torch.sigmoid(outputs.present)[0]),
    )
