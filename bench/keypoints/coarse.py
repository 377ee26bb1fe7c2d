"""The first network: finds twelve points of the catheter in the whole image."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F
from bench.keypoints.pictures import lit_otherwise, with_tubes
from bench.keypoints.samples import Sample
from torch import Tensor, nn

from tipforce.types import FloatArray
from tipforce.vision.keypoints import LENGTH_PX, STRIDE, evenly, normalised

__all__ = ["POINTS", "Coarse", "Window", "loss", "window"]

POINTS = 12
"""Number of points, evenly spaced in arc length from base to tip."""
SIZE = 144
"""Side in px of the training windows; the network reads images of any size."""
CELLS = SIZE // STRIDE
HEATMAP_SIGMA_CELLS = 0.7
"""Standard deviation of the target heatmap of a point, in cells."""


def _conv(inputs: int, outputs: int, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, stride, dilation, dilation=dilation, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, width: int, dilation: int = 1) -> None:
        super().__init__()
        self.a = _conv(width, width, 1, dilation)
        self.b = nn.Sequential(nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.b(self.a(x)))


class Coarse(nn.Module):
    """(b, 3, h, w), sides divisible by 16 -> (b, POINTS + 1, h / 4, w / 4): logits of the points, and of the body."""

    def __init__(self, fine: int = 48, middle: int = 80, deep: int = 144) -> None:
        super().__init__()
        self.fold = nn.PixelUnshuffle(STRIDE)
        self.stem = _conv(3 * STRIDE**2, fine)
        self.down1 = nn.Sequential(_conv(fine, middle, 2), _Residual(middle), _Residual(middle))
        self.down2 = nn.Sequential(_conv(middle, deep, 2), _Residual(deep), _Residual(deep, 2), _Residual(deep))
        self.up1, self.mix1 = nn.Conv2d(deep, middle, 1), _conv(middle, middle)
        self.up2, self.mix2 = nn.Conv2d(middle, fine, 1), _conv(fine, fine)
        self.head = nn.Conv2d(fine, POINTS + 1, 1)
        nn.init.constant_(self.head.bias, -4.0)

    def forward(self, x: Tensor) -> Tensor:
        fine = self.stem(self.fold(x))
        middle = self.down1(fine)
        deep = self.down2(middle)
        middle = self.mix1(middle + F.interpolate(self.up1(deep), scale_factor=2.0, mode="nearest"))
        fine = self.mix2(fine + F.interpolate(self.up2(middle), scale_factor=2.0, mode="nearest"))
        return self.head(fine)


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """``image`` (3, SIZE, SIZE), ``points`` (POINTS, 2) in px of it, ``body`` (CELLS, CELLS) of 0..255."""

    image: npt.NDArray[np.float32]
    points: npt.NDArray[np.float32]
    body: npt.NDArray[np.uint8]


def window(sample: Sample, rng: np.random.Generator) -> Window:
    """A window of ``sample``, turned, scaled, mirrored, in another light, with other tubes."""
    image, line = sample.small, sample.small_line
    diameter_px = sample.diameter_px / sample.length_px * LENGTH_PX
    if rng.random() < 0.45:
        image = with_tubes(image, line, diameter_px, LENGTH_PX, rng)
    turn, scale, stretch = math.radians(rng.normal(0.0, 7.0)), math.exp(rng.uniform(-0.16, 0.16)), rng.normal(0.0, 0.02)
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    matrix = scale * matrix @ np.diag([math.exp(stretch), math.exp(-stretch)])
    if rng.random() < 0.5:
        matrix = matrix @ np.diag([1.0, -1.0])
    shift = _shift(line @ matrix.T, matrix, image.shape[:2], rng)
    line = line @ matrix.T + shift
    cv_way = cv2.INTER_LINEAR if scale > 0.95 else cv2.INTER_AREA
    mean = tuple(image.reshape(-1, 3).mean(axis=0).tolist())
    drawn = cv2.warpAffine(
        image, np.column_stack([matrix, shift]), (SIZE, SIZE), flags=cv_way, borderMode=cv2.BORDER_CONSTANT,
        borderValue=mean,
    )  # fmt: skip
    lit = lit_otherwise(drawn.astype(np.float32), rng)
    for _ in range(int(rng.integers(0, 3)) if rng.random() < 0.5 else 0):
        (width, height), (u, v) = rng.integers(4, 22, 2), rng.integers(0, SIZE - 22, 2)
        lit[v : v + height, u : u + width] = rng.uniform(0.0, 255.0, 3)
    body = np.zeros((2 * CELLS, 2 * CELLS), np.uint8)
    half = 16.0 * ((line + 0.5) / 2.0 - 0.5)
    thick = max(1, round(0.5 * diameter_px * scale))
    cv2.polylines(body, [np.round(half).astype(np.int32)], False, 255, thick, cv2.LINE_AA, 4)
    body = cv2.resize(body, (CELLS, CELLS), interpolation=cv2.INTER_AREA)
    return Window(
        normalised(np.clip(lit, 0.0, 255.0)), evenly(line, POINTS).astype(np.float32), np.asarray(body, np.uint8)
    )


def _shift(line: FloatArray, matrix: FloatArray, size: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Returns the shift of the window: mostly it contains all of ``line`` (n, 2), and little beyond the image."""
    if rng.random() < 0.7:
        low, high = 2.0 - line.min(axis=0), SIZE - 2.0 - line.max(axis=0)
        fits = rng.uniform(np.minimum(low, high), np.maximum(low, high))
        shift = np.where(low < high, fits, 0.5 * (low + high))
    else:
        shift = rng.uniform(12.0, SIZE - 12.0, 2) - line[rng.integers(len(line))]
    if rng.random() < 0.9:
        height, width = size
        corners = np.sort(np.array([[0, 0], [width, 0], [0, height], [width, height]]) @ matrix.T, axis=0)
        low, high = SIZE - corners[2:].mean(axis=0), -corners[:2].mean(axis=0)
        shift = np.clip(shift, np.minimum(low, high), np.maximum(low, high))
    return shift


def loss(logits: Tensor, points: Tensor, body: Tensor) -> Tensor:
    """Returns the cross entropy of the cell of each point, or of "outside"; and that of the body."""
    cell = (points + 0.5) / STRIDE - 0.5
    grid = torch.arange(CELLS, dtype=torch.float32)
    across = torch.exp(-0.5 * ((grid - cell[..., 0:1]) / HEATMAP_SIGMA_CELLS) ** 2)
    down = torch.exp(-0.5 * ((grid - cell[..., 1:2]) / HEATMAP_SIGMA_CELLS) ** 2)
    target = (down[..., :, None] * across[..., None, :]).flatten(2)
    inside = ((cell > -0.5) & (cell < CELLS - 0.5)).all(-1)[..., None]
    target = torch.cat([target / target.sum(-1, keepdim=True).clamp_min(1e-6) * inside, (~inside).float()], -1)
    found = logits[:, :POINTS].flatten(2)
    found = F.log_softmax(torch.cat([found, torch.zeros_like(found[..., :1])], -1), -1)
    return -(target * found).sum(-1).mean() + 2.0 * F.binary_cross_entropy_with_logits(
        logits[:, POINTS], body.float() / 255.0
    )
