"""Small worlds with a known law: shape numbers and a knob, or images -> two force components, in sessions."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
import pytest

from tipforce.datasets import Dataset, open_dataset
from tipforce.estimators import ESTIMATORS, DcfeSettings, NetworkEstimator
from tipforce.estimators.networks import _network
from tipforce.types import Observation, SessionInfo, Status


@pytest.fixture
def world(tmp_path: Path) -> Callable[..., Dataset]:
    """A dataset of ready-made polynomials: ``sessions`` x ``frames``, noise in newtons, 30 Hz."""

    def make(
        sessions: int = 4, frames: int = 40, noise_n: float = 0.005, spread_n: float = 0.0, seed: int = 0
    ) -> Dataset:
        draw = np.random.default_rng(seed)
        folder = tmp_path / f"world-{sessions}-{frames}-{noise_n}-{spread_n}-{seed}"
        folder.mkdir(exist_ok=True)
        lines = ["shape_A1,shape_A2,shape_A3,shape_A4,shape_A5,session,stamp_ns,knob_deg,fx_n,fy_n"]
        for session in range(sessions):
            offset = draw.normal(0, spread_n, 2)
            phase = draw.uniform(0, 6)
            for frame in range(frames):
                push = 0.15 + 0.1 * np.sin(0.3 * frame + phase)
                side = 0.08 * np.cos(0.17 * frame + phase)
                knob = 10.0 + session % 3
                shape = [push - 0.02 * knob, 0.5 * side + push**2, side, 0.1 * knob + side * push, 0.0]
                shape = [value + draw.normal(0, 1e-4) * (place < 4) for place, value in enumerate(shape)]
                force = np.array([-push, side]) + offset + draw.normal(0, noise_n, 2)
                cells = [*shape, f"s{session}", frame * 33_333_333, knob, *force]
                lines.append(",".join(str(cell) for cell in cells))
        (folder / "metadata.csv").write_text("\n".join(lines) + "\n")
        return open_dataset(folder)

    return make


class Shown:
    """A store of images in memory, that counts how often each is read."""

    def __init__(self, images: list[Any], knob: np.ndarray) -> None:
        self.images, self.knob = images, knob
        self.reads = 0

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            self.reads += 1
            views = {} if self.images[row] is None else {"camera": self.images[row]}
            yield Observation(row * 10_000_000, views, {"knob_deg": float(self.knob[row])})


@pytest.fixture(scope="session")
def shown() -> Callable[..., Dataset]:
    """Grey images, 60 x 80, with a bright square whose place is the force."""

    def make(sessions: int = 3, each: int = 24, seed: int = 0, unseen: tuple[int, ...] = ()) -> Dataset:
        draw = np.random.default_rng(seed)
        count = sessions * each
        force = np.full((count, 3), np.nan)
        force[:, :2] = draw.uniform(-0.2, 0.2, (count, 2))
        images: list[Any] = []
        for x, y in force[:, :2]:
            image = draw.integers(90, 110, (60, 80), dtype=np.uint8)
            image[round(26 + 100 * y) : round(34 + 100 * y), round(36 + 150 * x) : round(44 + 150 * x)] = 250
            images.append(image)
        for place in unseen:
            images[place] = None
        knob = draw.choice([10.0, 30.0], count)
        names = np.repeat([f"s{k}" for k in range(sessions)], each)
        return Dataset(
            store=Shown(images, knob),
            session=names,
            stamp_ns=np.arange(count) * 10_000_000,
            actuation={"knob_deg": knob},
            force_n=force,
            known=np.array([True, True, False]),
            names=np.array([f"{place:03d}.png" for place in range(count)]),
            session_info={f"s{k}": SessionInfo(name=f"s{k}") for k in range(sessions)},
            rows=np.arange(count),
            title="squares",
        )

    return make


class SmallTask:
    """A few thousand weights in place of ResNet-18's eleven million."""

    name = "small"
    inputs = ("image",)
    head = ("dense.",)

    def __init__(self, outputs: int, actuation: tuple[Any, ...]) -> None:
        self.outputs = outputs
        self.inputs = ("image", "actuation") if actuation else ("image",)

    def adapted(self, weights: Any) -> Any:
        return weights

    def build(self) -> Any:
        import torch
        from torch import nn

        class Network(nn.Module):
            def __init__(self, outputs: int, more: int) -> None:
                super().__init__()
                self.body = nn.Sequential(
                    nn.Conv2d(3, 8, 5, 2), nn.BatchNorm2d(8), nn.ReLU(), nn.Conv2d(8, 8, 5, 2), nn.ReLU(), nn.Flatten()
                )
                self.dense = nn.Linear(200 + more, outputs)

            def forward(self, image: torch.Tensor, actuation: torch.Tensor | None = None) -> torch.Tensor:
                pooled = self.body(image.permute(0, 3, 1, 2).float() / 255.0 - 0.4)
                return self.dense(pooled if actuation is None else torch.cat([pooled, actuation / 30.0], dim=1))

        return Network(self.outputs, len(self.inputs) - 1)

    def batch(self, samples: Any, index: Any, draws: Any) -> dict[str, Any]:
        more = {name: values[index] for name, values in samples.inputs.items()}
        return {"image": samples.images[index], "force_n": samples.force_n[index], **more}

    def loss(self, outputs: Any, batch: Any) -> Any:
        return ((outputs - batch["force_n"]) ** 2).mean()

    def error_n(self, outputs: Any, batch: Any) -> Any:
        return (outputs - batch["force_n"]).abs().mean(dim=1)


class Small(NetworkEstimator):
    name: ClassVar[str] = "small"
    settings_type = DcfeSettings

    def __init__(self, settings: DcfeSettings | None = None) -> None:
        super().__init__(settings or QUICK)

    def input_specs(self, *, training: bool) -> Any:
        return {"image": ((32, 32, 3), "uint8")}

    def reader(self, info: SessionInfo, *, training: bool) -> Any:
        def read(observation: Observation, mask: Any = None) -> Any:
            view = observation.views.get("camera")
            if view is None:
                return _network.Abstention(Status.NO_CATHETER, "nothing was filmed")
            return {"image": np.repeat(cv2.resize(view, (32, 32))[:, :, None], 3, axis=2)}

        return read

    def task(self, known: np.ndarray, base_frame: bool, actuation: tuple[Any, ...]) -> SmallTask:
        return SmallTask(int(known.sum()), actuation)


QUICK = DcfeSettings(epochs=12, batch=8, rate=0.05, schedule="constant", precision="fp32", validation=0.2)


@pytest.fixture(scope="session")
def small_type() -> type[Small]:
    return Small


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Small:
    """A small network, known by its name."""
    monkeypatch.setitem(ESTIMATORS._loaded, "small", Small)
    return Small(QUICK)
