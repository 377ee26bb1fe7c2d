"""A world small enough to learn in seconds, and a network of a few thousand weights."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from tipforce.training import TrainConfig, TrainingSamples


def bars_drawn(count: int = 64, sessions: int = 4, seed: int = 0) -> TrainingSamples:
    """A bright square whose place is the force."""
    draw = np.random.default_rng(seed)
    force = draw.uniform(-0.2, 0.2, (count, 2)).astype(np.float32)
    images = draw.integers(90, 110, (count, 32, 32, 3), dtype=np.uint8)
    for image, (x, y) in zip(images, force, strict=True):
        column, row = round(16 + 60 * x), round(16 + 60 * y)
        image[row - 2 : row + 2, column - 2 : column + 2] = 250
    return TrainingSamples(images, force, np.repeat([f"s{k}" for k in range(sessions)], count // sessions))


class Tiny:
    """Bytes to forces, with dropout and images altered at random: all that may draw, draws."""

    name = "tiny"
    inputs = ("image",)
    head = ("dense.",)

    def __init__(self, outputs: int = 2) -> None:
        self.outputs = outputs
        self.drawn: list[tuple[int, float]] = []

    def adapted(self, weights: Any) -> Any:
        return weights

    def build(self) -> Any:
        import torch
        from torch import nn

        class Network(nn.Module):
            def __init__(self, outputs: int) -> None:
                super().__init__()
                self.body = nn.Sequential(
                    nn.Conv2d(3, 8, 5, 2), nn.BatchNorm2d(8), nn.ReLU(), nn.Conv2d(8, 8, 5, 2), nn.ReLU(), nn.Flatten()
                )
                self.drop = nn.Dropout(0.1)
                self.dense = nn.Linear(8 * 25, outputs)

            def forward(self, image: torch.Tensor) -> torch.Tensor:
                return self.dense(self.drop(self.body(image.permute(0, 3, 1, 2).float() / 255.0 - 0.4)))

        return Network(self.outputs)

    def batch(
        self, samples: TrainingSamples, index: np.ndarray, draws: Sequence[np.random.Generator] | None
    ) -> dict[str, Any]:
        images = samples.images[index]
        if draws is not None:
            noise = np.stack([draw.integers(0, 4, images.shape[1:], dtype=np.uint8) for draw in draws])
            self.drawn += zip(index.tolist(), noise.mean(axis=(1, 2, 3)).tolist(), strict=True)
            images = images + noise
        return {"image": images, "force_n": samples.force_n[index]}

    def loss(self, outputs: Any, batch: Mapping[str, Any]) -> Any:
        return ((outputs - batch["force_n"]) ** 2).mean()

    def error_n(self, outputs: Any, batch: Mapping[str, Any]) -> Any:
        return (outputs - batch["force_n"]).abs().mean(dim=1)


@pytest.fixture
def bars() -> Callable[..., TrainingSamples]:
    return bars_drawn


@pytest.fixture
def tiny() -> type[Tiny]:
    pytest.importorskip("torch", reason="training needs the extra [train]")
    return Tiny


@pytest.fixture
def quick() -> TrainConfig:
    return TrainConfig(epochs=3, batch=16, rate=0.05, precision="fp32")
