"""A small session on disk: a tube that bends more and less under a force, as a video, and a model trained on it."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import Dataset
from tipforce.estimators import Estimator, create, save_model
from tipforce.geometry import curve_from_angle
from tipforce.io import write_video
from tipforce.types import BasePose, Frame, Observation, SessionInfo
from tipforce.vision import VisionSettings

VISION = VisionSettings(polarity="dark", base_side="left")


def draw_image(bend: float) -> np.ndarray:
    """(240, 320) grey; the tube comes from the left and turns by ``bend`` rad."""
    base = BasePose(np.array([-20.0, 150.0]), -0.02)
    axis = base.to_image(curve_from_angle(np.array([0.4, 0.5, 0.1]) * bend, 220.0, 200))
    image = np.full((240, 320), 215, np.uint8)
    cv2.polylines(image, [np.round(axis * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(round(1e6 * bend)).normal(0, 2, image.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


def bend_at(place: int) -> float:
    return 0.8 + 0.5 * np.sin(0.55 * place)


class Images:
    """Samples drawn as they are asked for; the force is 0.2 N a rad of bending, along y."""

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(row * 40_000_000, {"camera": draw_image(bend_at(row))}, {"knob_deg": 10.0})


@pytest.fixture(scope="session")
def true_n() -> list[float]:
    """The force on each frame of `video`."""
    return [0.2 * (bend_at(k) + 0.02) for k in range(20)]


@pytest.fixture(scope="session")
def samples() -> Dataset:
    count = 48
    force = np.full((count, 3), np.nan)
    force[:, 0], force[:, 1] = 0.0, [0.2 * bend_at(k) for k in range(count)]
    sessions = np.array([f"s{k // 12}" for k in range(count)])
    return Dataset(
        store=Images(),
        session=sessions,
        stamp_ns=np.arange(count) * 40_000_000,
        actuation={"knob_deg": np.full(count, 10.0)},
        force_n=force,
        known=np.array([True, True, False]),
        names=np.arange(count).astype(str),
        session_info={name: SessionInfo(name=name) for name in np.unique(sessions).tolist()},
        rows=np.arange(count),
    )


@pytest.fixture(scope="session")
def trained(samples: Dataset) -> Estimator:
    return create("svr", {"vision": VISION, "force": "components"}).fit(samples)


@pytest.fixture(scope="session")
def model(trained: Estimator, samples: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_model(trained, tmp_path_factory.mktemp("models") / "svr", samples)


@pytest.fixture(scope="session")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """20 frames at 25 Hz; nothing but ground in frames 8 and 9."""
    path = tmp_path_factory.mktemp("video") / "beat.mp4"
    images = [draw_image(bend_at(k) + 0.02) for k in range(20)]
    images[8] = images[9] = np.full((240, 320), 215, np.uint8)
    write_video(path, (Frame(k * 40_000_000, image) for k, image in enumerate(images)), 25.0)
    return path
