"""A folder of images of a tube that bends, with the true line of each, and a job on it whose detector is a fake."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.annotation import AnnotationImages, AnnotationSession, AnnotationStore, MarkedFrame
from tipforce.geometry import curve_from_angle
from tipforce.types import BasePose, CentrelinePx, DetectedShape, FloatArray, Image, Status

COUNT = 14
SIZE_PX = (320, 240)


def true_line(bend: float) -> FloatArray:
    """(200, 2) px, from the left border to the tip."""
    return BasePose(np.array([6.0, 130.0]), -0.02).to_image(
        curve_from_angle(np.array([0.4, 0.5, 0.1]) * bend, 200.0, 200)
    )


def draw(bend: float) -> Image:
    """(240, 320, 3) RGB: a dark tube before a ground with spots, which optical flow can follow."""
    ground = np.random.default_rng(5).normal(200, 25, (30, 40)).clip(150, 240).astype(np.uint8)
    image = cv2.resize(ground, SIZE_PX, interpolation=cv2.INTER_CUBIC)
    points = np.round(true_line(bend) * 16).astype(np.int32)
    cv2.polylines(image, [points], False, 45, 9, cv2.LINE_AA, 4)
    for at in range(20, 200, 30):  # rings, as on a real shaft
        cv2.circle(image, (points[at] + 8) // 16, 3, 110, -1, cv2.LINE_AA)
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)  # type: ignore[return-value]


def shape_along(line: FloatArray, probability: float = 0.95) -> DetectedShape:
    base = BasePose(line[0], 0.0)
    return DetectedShape(Status.VALID, "", CentrelinePx(line), base, 9.0, 1.0, probability_right=probability)


NOTHING = DetectedShape(Status.NO_CATHETER, "no shaft reaches a border")


def bends() -> list[float]:
    return [0.5 + 0.08 * k for k in range(COUNT)]


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same images, not to be changed."""
    folder = tmp_path_factory.mktemp("annotation") / "frames"
    folder.mkdir()
    for k, bend in enumerate(bends()):
        cv2.imwrite(str(folder / f"img{k:03d}.png"), cv2.cvtColor(draw(bend), cv2.COLOR_RGB2BGR))
    return folder


@pytest.fixture
def folder(shared_folder: Path, tmp_path: Path) -> Path:
    """``frames/img000.png`` to ``img013.png``, in a folder of the test's own."""
    own = tmp_path / "frames"
    shutil.copytree(shared_folder, own)
    return own


@pytest.fixture
def images(folder: Path) -> AnnotationImages:
    return AnnotationImages(folder)


@pytest.fixture
def store(folder: Path) -> AnnotationStore:
    return AnnotationStore(folder)


@pytest.fixture
def make_session(
    images: AnnotationImages, store: AnnotationStore
) -> Callable[[list[DetectedShape]], AnnotationSession]:
    """(the detected shape of each of the first images) -> a session of these images."""

    def make(shapes: list[DetectedShape]) -> AnnotationSession:
        names = [f"img{k:03d}.png" for k in range(len(shapes))]
        store.add(MarkedFrame.empty(name) for name in names)
        return AnnotationSession(store, images.read(names), [0] * len(names), shapes)

    return make


@dataclass(frozen=True)
class FakeLeftOut:
    image: str
    before_px: FloatArray
    after_px: FloatArray
    before_present: float = 0.9
    after_present: float = 0.9


@dataclass(frozen=True)
class FakeDetector:
    folder: Path
    seconds: float
    left_out: tuple[FakeLeftOut, ...]
