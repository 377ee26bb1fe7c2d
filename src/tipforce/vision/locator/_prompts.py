"""The prompts of the locator: everything that a user states or earlier images have shown, as image channels."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...types import Box, FloatArray

CHANNELS = 7
"""Base, tip, shaft, length stated, log length, diameter stated, log diameter. Nothing states a tip or points on the
shaft yet: these two channels stay 0, as in a third of the training."""
BASE, SIZES = 0, (3, 5)
"""Channel of the base, and the first channel of length and of diameter."""
NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX = 110.0, 6.0
"""Size of the catheter in the network's image at which the logarithms are 0."""
BASE_SIGMA_PX = 5.0
"""Standard deviation of the blob at a stated base, in px of the network's image."""
MIN_SIZE_PX = 0.5
"""A smaller length or diameter counts as this."""
REACH_LENGTHS = 1.3
"""The image is read as far as this number of lengths from the base: the stated length may be too small."""
BORDER_REACH_PX = 24.0
"""Width of the ramp along a stated border, in px of the network's image."""
REGION_VALUE = 0.5
"""Value of a stated region or border: the base is somewhere there."""


@dataclass(frozen=True, slots=True, eq=False)
class Prompts:
    """Stated properties of the catheter in one image; None where nothing is stated.

    Attributes:
        base_px: (2,) u, v of the base, px.
        region: box that holds the base, px.
        border: border of the image that the catheter comes from.
        length_px: length from base to tip, px.
        diameter_px: diameter of the shaft, px.
        near_px: (2,) u, v of a point near a base that is not known: no prompt, the image is read around it.
        xray: the image is an X-ray image: no prompt, lines have weights of their own there.
    """

    base_px: FloatArray | None = None
    region: Box | None = None
    border: str | None = None
    length_px: float | None = None
    diameter_px: float | None = None
    near_px: FloatArray | None = None
    xray: bool = False

    def window(self, rows: int, columns: int) -> Box:
        """Returns the part of the image, u0, v0, u1, v1, that the catheter reaches from its base.

        The whole image where the base or the length is not known, or the base is far outside.

        Args:
            rows: height of the image.
            columns: width of the image.
        """
        near = self.near_px if self.base_px is None else self.base_px
        at = self.region if near is None else (*near, *near)
        if at is None or self.length_px is None:
            return 0, 0, columns, rows
        reach = REACH_LENGTHS * self.length_px
        u0, v0, u1, v1 = at[0] - reach, at[1] - reach, at[2] + reach, at[3] + reach
        found = max(math.floor(u0), 0), max(math.floor(v0), 0), min(math.ceil(u1), columns), min(math.ceil(v1), rows)
        return found if found[0] < found[2] and found[1] < found[3] else (0, 0, columns, rows)

    def inside(self, window: Box, rows: int, columns: int) -> "Prompts":
        """Returns the prompts for the part ``window`` of an image of ``rows`` and ``columns``."""
        u0, v0, u1, v1 = window
        cut = {"left": u0 > 0, "top": v0 > 0, "right": u1 < columns, "bottom": v1 < rows}
        region = self.region
        return replace(
            self,
            base_px=None if self.base_px is None else self.base_px - (u0, v0),
            region=None if region is None else (region[0] - u0, region[1] - v0, region[2] - u0, region[3] - v0),
            border=None if self.border is None or cut[self.border] else self.border,
        )

    def at_scale(self, scale: float) -> "Prompts":
        """Returns the prompts for the image resized by ``scale``."""
        region = self.region
        if region is not None:
            u0, v0, u1, v1 = (scale * edge for edge in region)
            region = math.floor(u0), math.floor(v0), math.ceil(u1), math.ceil(v1)
        return replace(
            self,
            base_px=None if self.base_px is None else (self.base_px + 0.5) * scale - 0.5,
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

    base = planes[BASE]
    if prompts.base_px is not None:
        across = np.exp(-0.5 * ((u - prompts.base_px[0]) / BASE_SIGMA_PX) ** 2)
        down = np.exp(-0.5 * ((v - prompts.base_px[1]) / BASE_SIGMA_PX) ** 2)
        np.maximum(base, down[:, None] * across, out=base)
    if prompts.region is not None:
        u0, v0, u1, v1 = prompts.region
        box = ((v >= v0) & (v < v1))[:, None] & ((u >= u0) & (u < u1))
        np.maximum(base, REGION_VALUE * box, out=base)
    if prompts.border is not None:
        from_border = {
            "left": u[None], "right": (columns - 1 - u)[None], "top": v[:, None], "bottom": (rows - 1 - v)[:, None],
        }  # fmt: skip
        ramp = np.maximum(1.0 - from_border[prompts.border] / BORDER_REACH_PX, 0.0)
        np.maximum(base, REGION_VALUE * ramp, out=base)
    sizes = ((prompts.length_px, NOMINAL_LENGTH_PX), (prompts.diameter_px, NOMINAL_DIAMETER_PX))
    for first, (stated, nominal) in zip(SIZES, sizes, strict=True):
        if stated is not None:
            planes[first] = 1.0
            planes[first + 1] = math.log(max(stated, MIN_SIZE_PX) / nominal)
    return planes
