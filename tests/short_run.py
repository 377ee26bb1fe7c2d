"""A short bench run as files: a video of a bending tube, and a force log with its own clock and bias."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.io import RecordingWriter, write_video
from tipforce.types import Actuation, Frame, SensorInfo, SessionInfo, ViewInfo, Wrench

OFFSET_S = 0.04
BIAS = np.array([0.3, -0.1])


def push(t: np.ndarray) -> np.ndarray:
    """How hard the wall pushes, 0..1.3: free for two seconds, then a beat with a pause in it."""
    beat = np.maximum(0.0, np.sin(2 * np.pi * 1.3 * t) + 0.3 + 0.2 * np.sin(2 * np.pi * 0.31 * t))
    return np.where(t < 2.0, 0.0, beat)


def draw_image(bend: float) -> np.ndarray:
    """(120, 160) grey."""
    image = np.full((120, 160), 210, np.uint8)
    x = np.arange(0, 120)
    points = np.stack([x, 60 - 20 * bend * (x / 120) ** 2], axis=1)
    cv2.polylines(image, [np.round(points * 16).astype(np.int32)], False, 40, 6, cv2.LINE_AA, 4)
    return image


@dataclass(frozen=True)
class Run:
    """Paths of the files, and the frames' stamps."""

    video: Path
    force: Path
    stamp_ns: np.ndarray


def force_readings(per_second: int, rng: np.random.Generator) -> np.ndarray:
    """(8 per_second, 3): time in s, fx and fy in N with noise and the bias of the sensor."""
    t = np.arange(8 * per_second) / per_second
    force = np.outer(push(t + OFFSET_S), [0.05, -0.2]) + BIAS + rng.normal(0, 0.003, (len(t), 2))
    return np.round(np.column_stack([t, force]), 4)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Eight seconds at 24 frames/s with jitter and 250 forces/s; camera time = force time + 40 ms."""
    folder, rng = tmp_path_factory.mktemp("run"), np.random.default_rng(0)
    seconds = np.arange(192) / 24 + rng.uniform(0, 2e-3, 192)
    stamps = np.rint(seconds * 1e9).astype(np.int64)
    write_video(folder / "video.mp4", (Frame(int(s), draw_image(float(push(s * 1e-9)))) for s in stamps), 24)
    rows = [f"{a:.3f},{b:.4f},{c:.4f}" for a, b, c in force_readings(250, rng)]
    (folder / "force.csv").write_text("time_s,fx_n,fy_n\n" + "\n".join(rows) + "\n")
    return Run(folder / "video.mp4", folder / "force.csv", stamps - stamps[0])


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """One second: 1 kHz force in the sensor's frame, 25 grey frames a second, a knob that moves."""
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo("first", views={"camera": ViewInfo(2e-4)})) as writer:
        writer.state(SensorInfo(90.0, "tip-on-tissue"))
        for k in range(1000):
            stamp = k * 1_000_000
            if k % 100 == 0:
                writer.write(Actuation(stamp, {"knob_deg": k / 100}))
            writer.write(Wrench(stamp, np.array([k * 1e-3, 0.0, np.nan]), np.full(3, np.nan), "sensor"))
            if k % 40 == 0:
                writer.write(Frame(stamp, np.full((48, 64), 50 + k // 40, np.uint8)))
    return path
