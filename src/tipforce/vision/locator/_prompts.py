"""The prompts of the locator: everything that a user states or earlier images have shown, as image channels."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...types import Box, FloatArray

CHANNELS = 7
"""Base, tip, shaft, length stated, log length, diameter stated, log diameter."""
NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX = 110.0, 6.0
"""Size of the catheter in the network's image at which the logarithms are 0."""
END_SIGMA_PX, SHAFT_SIGMA_PX = 5.0, 4.0
"""Standard deviations of the blobs at the stated points, in px of the network's image."""
BORDER_REACH_PX = 24.0
"""Width of the ramp along a stated border, in px of the network's image."""
REGION_VALUE, TRACK_VALUE = 0.5, 0.6
"""Values of a stated region, which holds the base somewhere, and of the line of the image before."""


@dataclass(frozen=True, slots=True, eq=False)
class Prompts:
    """Stated properties of the catheter in one image; None where nothing is stated.

    Attributes:
        base_px: (2,) u, v of the base, px.
        tip_px: (2,) u, v of the tip, px.
        shaft_px: (k, 2) points on the shaft, px.
        track_px: (n, 2) the line in the image before, base to tip, px.
        region: box that holds the base, px.
        border: border of the image that the catheter comes from.
        length_px: length from base to tip, px.
        diameter_px: diameter of the shaft, px.
    """

    base_px: FloatArray | None = None
    tip_px: FloatArray | None = None
    shaft_px: FloatArray | None = None
    track_px: FloatArray | None = None
    region: Box | None = None
    border: str | None = None
    length_px: float | None = None
    diameter_px: float | None = None

    def at_scale(self, scale: float, offset_px: tuple[float, float] = (0.0, 0.0)) -> "Prompts":
        """Returns the prompts for an image that was moved by ``offset_px`` (u, v) and then resized by ``scale``."""

        def moved(points: FloatArray | None) -> FloatArray | None:
            return None if points is None else (points + np.array(offset_px) + 0.5) * scale - 0.5

        region = self.region
        if region is not None:
            u0, v0, u1, v1 = region
            left, top = offset_px
            low, high = ((u0 + left) * scale, (v0 + top) * scale), ((u1 + left) * scale, (v1 + top) * scale)
            region = math.floor(low[0]), math.floor(low[1]), math.ceil(high[0]), math.ceil(high[1])
        return replace(
            self,
            base_px=moved(self.base_px),
            tip_px=moved(self.tip_px),
            shaft_px=moved(self.shaft_px),
            track_px=moved(self.track_px),
            region=region,
            length_px=None if self.length_px is None else self.length_px * scale,
            diameter_px=None if self.diameter_px is None else self.diameter_px * scale,
        )


def channels(prompts: Prompts, rows: int, columns: int) -> npt.NDArray[np.float32]:
    """Returns the prompts as image channels.

    Args:
        prompts: in px of the network's image.
        rows: height of that image.
        columns: width of that image.

    Returns:
        (`CHANNELS`, rows, columns).
    """
    u, v = np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32)
    planes = np.zeros((CHANNELS, rows, columns), np.float32)

    def blobs(plane: npt.NDArray[np.float32], points: FloatArray, sigma_px: float, value: float = 1.0) -> None:
        """Raises ``plane`` to the largest of the blobs around ``points`` (k, 2)."""
        for at_u, at_v in points.tolist():
            across = np.exp(-0.5 * ((u - at_u) / sigma_px) ** 2)
            down = value * np.exp(-0.5 * ((v - at_v) / sigma_px) ** 2)
            np.maximum(plane, down[:, None] * across[None], out=plane)

    if prompts.base_px is not None:
        blobs(planes[0], prompts.base_px[None], END_SIGMA_PX)
    if prompts.region is not None:
        u0, v0, u1, v1 = prompts.region
        box = ((v >= v0) & (v <= v1 - 1))[:, None] & ((u >= u0) & (u <= u1 - 1))
        np.maximum(planes[0], REGION_VALUE * box, out=planes[0])
    if prompts.border is not None:
        from_border = {
            "left": u[None], "right": (columns - 1 - u)[None], "top": v[:, None], "bottom": (rows - 1 - v)[:, None],
        }  # fmt: skip
        ramp = np.maximum(1.0 - from_border[prompts.border] / BORDER_REACH_PX, 0.0)
        np.maximum(planes[0], REGION_VALUE * ramp, out=planes[0])
    if prompts.tip_px is not None:
        blobs(planes[1], prompts.tip_px[None], END_SIGMA_PX)
    if prompts.shaft_px is not None:
        blobs(planes[2], prompts.shaft_px, SHAFT_SIGMA_PX)
    if prompts.track_px is not None:
        blobs(planes[2], prompts.track_px, SHAFT_SIGMA_PX, TRACK_VALUE)
    sizes = ((prompts.length_px, NOMINAL_LENGTH_PX), (prompts.diameter_px, NOMINAL_DIAMETER_PX))
    for k, (stated, nominal) in enumerate(sizes):
        if stated is not None:
            planes[3 + 2 * k] = 1.0
            planes[4 + 2 * k] = math.log(max(stated, 0.5) / nominal)
    return planes
