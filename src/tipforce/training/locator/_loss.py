"""The training loss of the locator, and the schedule of its learning rate."""

import torch
import torch.nn.functional as F
from torch import Tensor

from ._labels import CATHETER, HIDDEN, OUTSIDE, UNLABELLED
from ._network import LINE_POINTS, OBJECT_KINDS, STRIDE_PX, LocatorOutputs

HEATMAP_SIGMA_CELLS = 0.7
"""Standard deviation of the target heat map of a point."""
HIDDEN_POINT_WEIGHT = 0.5
"""Weight of the heat map of a hidden point; a seen one has weight 1."""
LOSS_WEIGHTS = {
    "heat": 1.0, "kinds": 1.5, "arc": 2.0, "direction": 0.5, "offset": 0.3, "states": 0.5, "present": 0.3,
}  # fmt: skip


def locator_loss(
    outputs: LocatorOutputs, line_px: Tensor, state: Tensor, kind: Tensor, facts: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """Returns the training loss and its parts.

    Args:
        outputs: result of the network.
        line_px: (b, n, 2) u, v px of the true line, evenly spaced in arc length from base to tip.
        state: (b, n) states of its points: 0 outside, 1 hidden, 2 seen.
        kind: (b, h / 4, w / 4) kinds of the cells; NOT_CATHETER or UNLABELLED.
        facts: (b, 4): whether a catheter is present, then its diameter in px; the rest is not used.

    Returns:
        The weighted sum, and each part by its name in `LOSS_WEIGHTS`.
    """
    heat, kinds, dense, states, present = (value.float() for value in outputs)
    is_present = facts[:, 0] > 0.5
    index = torch.linspace(0, line_px.shape[1] - 1, LINE_POINTS, device=line_px.device).round().long()
    true_state = torch.where(is_present[:, None], state[:, index].long(), OUTSIDE)
    parts = {"heat": _heat_loss(heat, line_px[:, index], true_state, is_present)}
    log_kinds = F.log_softmax(kinds, 1)
    known = kind < OBJECT_KINDS
    named = F.nll_loss(log_kinds, torch.where(known, kind, 0).long(), reduction="none")
    not_catheter = -torch.log1p(-log_kinds[:, CATHETER].exp().clamp(max=0.9999))
    parts["kinds"] = (torch.where(known, named, not_catheter) * (kind != UNLABELLED)).mean()
    parts |= _dense_losses(dense, line_px, facts[:, 1], is_present)
    parts["states"] = F.cross_entropy(states.flatten(0, 1), true_state.flatten())
    parts["present"] = F.binary_cross_entropy_with_logits(present, is_present.float())
    return torch.stack([LOSS_WEIGHTS[name] * value for name, value in parts.items()]).sum(), parts


def _heat_loss(heat: Tensor, points_px: Tensor, state: Tensor, is_present: Tensor) -> Tensor:
    """Returns the cross entropy of the position of each point; "outside of the image" is one more position."""
    b, _, h, w = heat.shape
    cell = (points_px + 0.5) / STRIDE_PX - 0.5
    u = torch.arange(w, device=heat.device, dtype=torch.float32)
    v = torch.arange(h, device=heat.device, dtype=torch.float32)
    across = torch.exp(-0.5 * ((u - cell[..., 0:1]) / HEATMAP_SIGMA_CELLS) ** 2)
    down = torch.exp(-0.5 * ((v - cell[..., 1:2]) / HEATMAP_SIGMA_CELLS) ** 2)
    target = (down[..., :, None] * across[..., None, :]).flatten(2)
    inside = ((cell > -0.5) & (cell < torch.tensor([w - 0.5, h - 0.5], device=heat.device))).all(-1)
    inside &= is_present[:, None] & (state != OUTSIDE)
    target = target / target.sum(-1, keepdim=True).clamp_min(1e-6) * inside[..., None]
    target = torch.cat([target, (~inside)[..., None].float()], -1)
    logits = torch.cat([heat.flatten(2), heat.new_zeros(b, LINE_POINTS, 1)], -1)
    weight = torch.where(state == HIDDEN, HIDDEN_POINT_WEIGHT, 1.0)
    return (-(target * F.log_softmax(logits, -1)).sum(-1) * weight).mean()


def _dense_losses(dense: Tensor, line_px: Tensor, diameter_px: Tensor, is_present: Tensor) -> dict[str, Tensor]:
    """Returns the errors of arc length, direction and offset, over the cells on the catheter."""
    b, _, h, w = dense.shape
    u = torch.arange(w, device=dense.device, dtype=torch.float32)
    v = torch.arange(h, device=dense.device, dtype=torch.float32)
    grid = torch.stack(torch.meshgrid(v, u, indexing="ij")[::-1], -1).reshape(1, -1, 2)
    line = (line_px + 0.5) / STRIDE_PX - 0.5
    distance, nearest = torch.cdist(grid.expand(b, -1, -1), line).min(-1)
    reach = (0.5 * diameter_px[:, None] / STRIDE_PX).clamp_min(0.75) + 0.5
    on_catheter = (distance < reach) & is_present[:, None]
    true_arc = nearest.float() / (line.shape[1] - 1)
    steps = line[:, 1:] - line[:, :-1]
    tangents = F.normalize(torch.cat([steps, steps[:, -1:]], 1), dim=-1)
    image_index = torch.arange(b, device=dense.device)[:, None]
    true_direction, true_offset = tangents[image_index, nearest], line[image_index, nearest] - grid
    values = dense.flatten(2).transpose(1, 2)
    errors = {
        "arc": (torch.sigmoid(values[..., 0]) - true_arc).abs(),
        "direction": 1.0 - F.cosine_similarity(values[..., 1:3], true_direction, dim=-1),
        "offset": (values[..., 3:5] - true_offset).abs().sum(-1),
    }
    count = on_catheter.float().sum().clamp_min(1.0)
    return {name: (error * on_catheter).sum() / count for name, error in errors.items()}


def linear_rate(step: int, steps: int, first: float, warmup: int = 30) -> float:
    """Returns the share of the full learning rate at a step of a training that continues an earlier one.

    Args:
        step: index of the step, from 0.
        steps: number of steps of this training.
        first: share at its beginning, after the rise; it falls linearly to 0.
        warmup: number of steps of the rise.
    """
    return first * min(1.0, (step + 1) / warmup) * max(0.0, 1.0 - step / steps)
