"""Prompts of the locator as channels of an image, and the input of its network."""

import torch
from torch import Tensor

PROMPT_CHANNELS = 7
"""Channels: base, tip, shaft, length stated (0 or 1), log length, diameter stated (0 or 1), log diameter."""
NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX = 110.0, 6.0
"""Length and diameter of the catheter whose logarithms are 0 in the prompts."""
CLICK_SIGMA_PX = 5.0
"""Standard deviation of the Gaussian that marks a base or a tip."""
SHAFT_SIGMA_PX = 4.0
"""Standard deviation of the Gaussians that mark points on the shaft."""
EARLIER_LINE_LEVEL = 0.6
"""Height of the Gaussians of the line of the frame before; clicks have height 1."""
REGION_LEVEL = 0.5
"""Level of a box that holds the base, and of the border that the catheter comes from."""
BORDER_REACH_PX = 24.0
"""Distance from a border at which its mark has fallen to 0."""
MIN_SIZE_PX = 0.5
"""Smaller lengths and diameters are taken for this."""


def prompt_channels(
    size_px: tuple[int, int], base: Tensor, region: Tensor, side: Tensor, tip: Tensor, clicks: Tensor, track: Tensor,
    sizes: Tensor,
) -> Tensor:  # fmt: skip
    """Returns the prompts of a batch as channels. A prompt that is not stated is NaN; its channel is 0.

    Args:
        size_px: rows and columns of the image.
        base: (b, 2) u, v px of a click on the base.
        region: (b, 4) u0, v0, u1, v1 px of a box that holds the base.
        side: (b, 1) border that the catheter comes from: 0 left, 1 right, 2 top, 3 bottom.
        tip: (b, 2) u, v px of a click on the tip.
        clicks: (b, k, 2) u, v px of clicks on the shaft.
        track: (b, n, 2) u, v px of the line of the frame before.
        sizes: (b, 2) length and diameter in px.

    Returns:
        (b, PROMPT_CHANNELS, rows, columns).
    """
    rows, columns = size_px
    v = torch.arange(rows, device=base.device, dtype=torch.float32)
    u = torch.arange(columns, device=base.device, dtype=torch.float32)

    def marks(points: Tensor, sigma_px: float) -> Tensor:
        """Returns the largest of the Gaussians around the points: (b, k, 2) -> (b, rows, columns)."""
        across = torch.exp(-0.5 * ((u - points[..., 0:1]) / sigma_px) ** 2).nan_to_num(0.0)
        down = torch.exp(-0.5 * ((v - points[..., 1:2]) / sigma_px) ** 2).nan_to_num(0.0)
        return (down[..., :, None] * across[..., None, :]).amax(1)

    inside_u = (u >= region[:, 0:1]) & (u <= region[:, 2:3])
    inside_v = (v >= region[:, 1:2]) & (v <= region[:, 3:4])
    box = REGION_LEVEL * (inside_v[:, :, None] & inside_u[:, None, :]).float()
    ramps = torch.stack(
        [
            (1.0 - u / BORDER_REACH_PX).clamp_min(0.0)[None].expand(rows, -1),
            (1.0 - (columns - 1 - u) / BORDER_REACH_PX).clamp_min(0.0)[None].expand(rows, -1),
            (1.0 - v / BORDER_REACH_PX).clamp_min(0.0)[:, None].expand(-1, columns),
            (1.0 - (rows - 1 - v) / BORDER_REACH_PX).clamp_min(0.0)[:, None].expand(-1, columns),
        ]
    )
    stated = torch.isfinite(side[:, 0])
    border = REGION_LEVEL * ramps[side[:, 0].nan_to_num(0.0).long()] * stated[:, None, None]
    at_base = torch.maximum(torch.maximum(marks(base[:, None], CLICK_SIGMA_PX), box), border)
    on_shaft = torch.maximum(marks(clicks, SHAFT_SIGMA_PX), EARLIER_LINE_LEVEL * marks(track[:, ::2], SHAFT_SIGMA_PX))
    channels = [at_base, marks(tip[:, None], CLICK_SIGMA_PX), on_shaft]
    for k, nominal_px in enumerate((NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX)):
        stated = torch.isfinite(sizes[:, k])
        logarithm = torch.log(sizes[:, k].nan_to_num(nominal_px).clamp_min(MIN_SIZE_PX) / nominal_px) * stated
        channels += [values[:, None, None].expand(-1, rows, columns) for values in (stated.float(), logarithm)]
    return torch.stack(channels, 1)


def network_input(image: Tensor, channels: Tensor) -> Tensor:
    """Joins images and prompts.

    Args:
        image: (b, h, w, 3) uint8, RGB.
        channels: (b, PROMPT_CHANNELS, h, w) of `prompt_channels`.

    Returns:
        (b, 3 + PROMPT_CHANNELS, h, w) float32: (RGB - 127) / 128, then the prompts.
    """
    return torch.cat([(image.permute(0, 3, 1, 2).float() - 127.0) / 128.0, channels], 1)
