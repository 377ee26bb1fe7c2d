"""The image straightened along a rough line: where the network finds the axis to a fraction of a px."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ...geometry import arc_length, resampled, tangents_and_normals
from ...types import FloatArray, Image

ALONG, ACROSS = 96, 32
"""Stations along the strip, and samples across it."""
_REACH = 0.12
"""The strip reaches beyond both ends of the line by this share of its length."""
HALF_WIDTH = 1.6
"""Half of its width in diameters."""
_FINE = 3
"""Samples of the image for each station, so that no pixel is skipped."""
_CONTRAST_FLOOR = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """The neighbourhood of a line.

    ``points``, ``normals`` (ALONG, 2): of the stations in the image; a normal points to the right of the way from base
    to tip as displayed. ``values`` (ACROSS, ALONG, 3): grey levels. ``inside`` (ACROSS, ALONG): where the image is.
    """

    points: FloatArray
    normals: FloatArray
    values: npt.NDArray[np.float32]
    inside: npt.NDArray[np.bool_]

    @property
    def inside_view(self) -> npt.NDArray[np.bool_]:
        """(ALONG,): whether each station is in the image."""
        return np.asarray(self.inside[ACROSS // 2 - 1 : ACROSS // 2 + 1].any(axis=0))


def _stations(line: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Points and unit normals, (count, 2) each, evenly along ``line`` (n, 2) and straight on beyond its ends."""
    reach = _REACH * float(arc_length(line)[-1])
    near = max(2, len(line) // 16)
    ways = [line[near] - line[0], line[-1] - line[-1 - near]]
    first, last = (way / max(math.hypot(*way), 1e-9) for way in ways)
    points = resampled(np.vstack([line[0] - reach * first, line, line[-1] + reach * last]), count)
    return points, tangents_and_normals(points)[1]


def straightened(image: Image, line: FloatArray, diameter_px: float) -> Strip:
    """Straightens ``image`` (h, w) or (h, w, 3) uint8 along ``line`` (n, 2), base to tip."""
    points, normals = _stations(line, _FINE * ALONG)
    offsets = np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS) * diameter_px
    u, v = (
        (at[None] + offsets[:, None] * across[None]).astype(np.float32)
        for at, across in zip(points.T, normals.T, strict=True)
    )
    read = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    fine = np.asarray(read, np.float32).reshape(ACROSS, ALONG, _FINE, -1)
    values = np.ascontiguousarray(np.broadcast_to(fine.mean(axis=2), (ACROSS, ALONG, 3)))
    height, width = image.shape[:2]
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    inside = np.asarray(inside.reshape(ACROSS, ALONG, _FINE).all(axis=2))
    return Strip(*_stations(line, ALONG), values, inside)


def strip_input(values: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """(3, ACROSS, ALONG): the ``values`` of a strip with zero mean and unit contrast, zero outside the image."""
    lit = values[inside] if inside.any() else values
    normalised = (values - lit.mean()) / (lit.std() + _CONTRAST_FLOOR)
    normalised[~inside] = 0.0
    return np.ascontiguousarray(normalised.transpose(2, 0, 1), np.float32)
