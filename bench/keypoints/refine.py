"""The second network: the axis, the base and the tip in the image straightened along a rough line."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F
from bench.keypoints.pictures import lit_otherwise
from bench.keypoints.samples import Sample
from torch import Tensor, nn

from tipforce.types import FloatArray
from tipforce.vision.keypoints import ACROSS, ALONG, evenly, straightened, strip_input

__all__ = ["Refine", "Target", "loss", "target"]

LINE_POINTS = 160
MOST_OFF = 1.4
"""Distance in diameters: the axis of a station further off is not learnt."""
TARGET_SIGMA_STATIONS = 0.7
"""Standard deviation of the target of an end, in stations."""
WRONG = 0.3
"""Share of strips along other lines than the catheter's."""


def _conv(inputs: int, outputs: int, stride: tuple[int, int] = (1, 1)) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.way = nn.Sequential(
            nn.Conv2d(width, width, (1, 3), 1, (0, dilation), dilation=(1, dilation), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, (1, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.way(x))


class Refine(nn.Module):
    """(b, 3, ACROSS, ALONG) -> five tensors, (b, ALONG) but the last.

    Offset of the axis in diameters, logarithm of its scale of error, logits of base and tip, and (b,) the logit that
    the strip is the catheter's.
    """

    def __init__(self, first: int = 24, second: int = 32, width: int = 96) -> None:
        super().__init__()
        self.front = nn.Sequential(
            _conv(3, first, (2, 1)), _conv(first, second, (2, 1)), _conv(second, second), _conv(second, second)
        )
        self.across = nn.Sequential(
            nn.Conv2d(second, width, (ACROSS // 4, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
        )
        self.along = nn.Sequential(*[_Residual(width, dilation) for dilation in (1, 2, 4, 8, 16)])
        self.head = nn.Conv2d(width, 5, 1)

    def forward(self, strip: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        y = self.head(self.along(self.across(self.front(strip))))[:, :, 0]
        return y[:, 0], y[:, 1].clamp(-6.0, 3.0), y[:, 2], y[:, 3], y[:, 4].mean(-1)


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """``strip`` (3, ACROSS, ALONG), and the line and the ends in it that the network learns.

    ``offset`` (ALONG,) of the true axis where ``asked``; ``ends`` (2,): stations of base and tip, -1 where they are not
    asked for; ``right``: 1 where the strip is the catheter's.
    """

    strip: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    asked: npt.NDArray[np.bool_]
    ends: npt.NDArray[np.float32]
    right: np.float32


def target(sample: Sample, rng: np.random.Generator) -> Target:
    """A strip of ``sample`` along a line near the true one, or along another."""
    diameter_px = sample.diameter_px * math.exp(rng.normal(0.0, 0.04))
    line = evenly(sample.line, LINE_POINTS)
    wrong = rng.random() < WRONG
    guess = _elsewhere(line, diameter_px, sample.image.shape, rng) if wrong else _disturbed(line, diameter_px, rng)
    strip = straightened(sample.image, guess, diameter_px)
    offset, near = _offsets(line, strip.points, strip.normals, diameter_px)
    (base, base_off), (tip, tip_off) = (_station(strip.points, end) for end in (line[0], line[-1]))
    right = not wrong or bool(
        near.sum() > 0.72 * ALONG
        and 0.0 <= base < 0.3 * ALONG
        and 0.7 * ALONG < tip <= ALONG - 1
        and max(base_off, tip_off) < 1.5 * diameter_px
    )
    lit = lit_otherwise(strip.values, rng)
    if rng.random() < 0.35:  # an object across the strip
        first = int(rng.integers(0, ALONG - 4))
        lit = lit.copy()
        lit[:, first : first + int(rng.integers(2, 12))] = rng.uniform(0.0, 255.0, 3)
    values = strip_input(np.clip(lit, 0.0, 255.0), strip.inside)
    if rng.random() < 0.5:
        values, offset = np.ascontiguousarray(values[:, ::-1]), -offset
    in_view = bool(strip.seen[int(np.clip(round(base), 0, ALONG - 1))])
    ends = np.array([base if right and in_view else -1.0, tip if right else -1.0], np.float32)
    return Target(values, offset.astype(np.float32), near & strip.seen & right, ends, np.float32(right))


def _disturbed(line: FloatArray, diameter_px: float, rng: np.random.Generator) -> FloatArray:
    """Returns ``line`` with errors like those of the first network or round: beside the line, and at both ends."""
    count, share = len(line), np.linspace(0.0, 1.0, len(line))
    modes = rng.integers(2, 7)
    weights = 1.2 * rng.normal(size=modes) / math.sqrt(modes) * diameter_px * rng.choice([0.6, 0.3, 0.12, 0.04])
    beside = weights @ np.cos(math.pi * np.arange(modes)[:, None] * share)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    moved = line + beside[:, None] * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    length = float(np.linalg.norm(np.diff(moved, axis=0), axis=1).sum())
    start, stop = np.clip(rng.normal(0.0, rng.choice([0.05, 0.02, 0.006]), 2), -0.1, 0.1) * length
    if start < 0.0:
        moved = np.vstack([moved[0] + start * tangent[0], moved])
    if stop > 0.0:
        moved = np.vstack([moved, moved[-1] + stop * tangent[-1]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(moved, axis=0), axis=1))])
    wanted = np.linspace(max(start, 0.0), arc[-1] + min(stop, 0.0), count)
    return np.column_stack([np.interp(wanted, arc, moved[:, k]) for k in (0, 1)])


def _elsewhere(line: FloatArray, diameter_px: float, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """A line like ``line`` that is not the catheter's: along the sheath, from the tip back, turned, anywhere."""
    kind = rng.random()
    if kind < 0.3:
        return line + (line[-1] - line[0]) * rng.uniform(0.25, 0.6) * rng.choice([-1.0, 1.0])
    if kind < 0.5:
        return line[::-1]
    turn = rng.normal(0.0, 0.5)
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    if kind < 0.8:
        return (line - line[0]) @ matrix.T + line[0] + rng.normal(0.0, 0.3, 2) * diameter_px
    size = np.array([shape[1], shape[0]])
    return (line - line.mean(axis=0)) @ matrix.T + rng.uniform(0.1, 0.9, 2) * size


def _offsets(
    line: FloatArray, points: FloatArray, normals: FloatArray, diameter_px: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Where ``line`` crosses the normal of each station, in diameters, and whether it does so nearby."""
    way = line[None] - points[:, None]
    along = (way * np.column_stack([normals[:, 1], -normals[:, 0]])[:, None]).sum(axis=-1)
    across = (way * normals[:, None]).sum(axis=-1)
    far = np.where(np.abs(across) > 2.2 * diameter_px, np.inf, np.abs(along))
    at, station = np.clip(far.argmin(axis=1), 1, len(line) - 2), np.arange(len(points))
    other = np.where(along[station, at] > 0.0, at - 1, at + 1)
    gap = np.maximum(np.abs(along[station, at] - along[station, other]), 1e-9)
    share = np.clip(np.abs(along[station, at]) / gap, 0.0, 1.0)
    offset = (1.0 - share) * across[station, at] + share * across[station, other]
    near = (far[station, at] < 0.75 * np.linalg.norm(points[1] - points[0])) & (np.abs(offset) < MOST_OFF * diameter_px)
    return offset / diameter_px, near


def _station(points: FloatArray, end: FloatArray) -> tuple[float, float]:
    """The station next to ``end`` (2,), as a fraction, and its distance in px."""
    apart = np.linalg.norm(points - end, axis=1)
    at = int(apart.argmin())
    low, high = max(at - 1, 0), min(at + 1, len(points) - 1)
    way = (points[high] - points[low]) / (high - low)
    return at + float((end - points[at]) @ way / (way @ way)), float(apart[at])


def loss(found: tuple[Tensor, ...], target: tuple[Tensor, ...]) -> Tensor:
    """Negative log-likelihood of the offsets (Laplace), cross entropy of both ends and of right or wrong."""
    offset, log_scale, base, tip, right = found
    true, asked, ends, is_right = target
    share = asked.float()
    line = (((offset - true).abs() * torch.exp(-log_scale) + log_scale) * share).sum() / share.sum().clamp_min(1.0)
    total = line + 0.5 * F.binary_cross_entropy_with_logits(right, is_right)
    grid = torch.arange(ALONG, dtype=torch.float32)
    for logits, end in ((base, ends[:, 0]), (tip, ends[:, 1])):
        wanted = torch.exp(-0.5 * ((grid - end[:, None]) / TARGET_SIGMA_STATIONS) ** 2)
        wanted = wanted / wanted.sum(1, keepdim=True).clamp_min(1e-6)
        use = ((end > 0.0) & (end < ALONG - 1)).float()
        total = total + 0.3 * (-(wanted * F.log_softmax(logits, -1)).sum(1) * use).sum() / use.sum().clamp_min(1.0)
    return total
