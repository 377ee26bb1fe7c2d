"""Inertia that repeats with the beat, removed without the stage's log."""

import numpy as np
import pytest

from tipforce.alignment import StageMotion, find_tare_and_inertia, inertia_left, tip_acceleration
from tipforce.alignment._inertia import carried_n
from tipforce.io import Inertia
from tipforce.types import CentrelinePx, FloatArray, IntArray, Status
from tipforce.vision import DetectedShape

STILL = StageMotion.of([])
MASS_KG, AMPLITUDE_M, BEAT_HZ = 0.05, 6e-3, 1.21
FREE_S, SECONDS = 5.0, 40.0


def log(
    *, seed: int = 0, jitter: float = 0.0, stopped_s: float = 0.0, free_s: float = FREE_S, touches: bool = False
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps, readings (n, 3) and the inertia in them: a wall on a beating stage, out of reach for ``free_s``.

    ``jitter``: of each beat's length; ``stopped_s``: how long the stage was stopped when the tip reached the wall.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 2e-3)
    lengths = rng.normal(1.0, jitter, round(SECONDS * BEAT_HZ) + 20) / BEAT_HZ
    beats = np.interp(time, np.concatenate([[0.0], np.cumsum(lengths)]), np.arange(len(lengths) + 1))
    beats -= np.where(time > free_s, stopped_s * BEAT_HZ, 0.0)
    forward = np.sin(2.0 * np.pi * beats) + 0.2 * np.sin(4.0 * np.pi * beats + 0.5)
    bent = np.sin(2.0 * np.pi * beats) + 0.8 * np.sin(4.0 * np.pi * beats + 0.5)
    carried = np.outer(MASS_KG * AMPLITUDE_M * (2.0 * np.pi * BEAT_HZ) ** 2 * bent, [0.8, 0.6, 0.0])
    pushed = np.maximum(forward + 0.6, 0.0) * ((time > free_s) | touches)
    force = carried - np.outer(0.12 * pushed, [0.8, 0.6, 0.0]) + [0.3, -0.1, 0.2]
    return np.rint(time * 1e9).astype(np.int64), force + rng.normal(0.0, 3e-3, force.shape), carried


def rms_left(stamps: IntArray, carried: FloatArray, inertia: Inertia) -> float:
    return float(np.sqrt(np.mean((carried - carried_n(STILL, inertia, stamps))[:, :2] ** 2)))


def test_the_inertia_of_a_regular_beat_is_removed_without_the_stages_log() -> None:
    stamps, force, carried = log()
    tare, inertia = find_tare_and_inertia(stamps, force, STILL, (0.0, 5.0), [], MASS_KG)
    assert inertia.beat_hz == pytest.approx(BEAT_HZ, abs=1e-3)
    assert rms_left(stamps, carried, Inertia()) > 9e-3
    assert rms_left(stamps, carried, inertia) < 1e-3
    np.testing.assert_allclose(tare.force_n, [0.3, -0.1, 0.2], atol=1e-3)
    assert inertia_left(stamps, force, STILL, tare, inertia) < 2e-3
    assert Inertia.of(inertia.record()).beat_n == pytest.approx(inertia.beat_n)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"jitter": 0.08}, "irregular"),
        ({"stopped_s": 0.4}, "the stage was stopped"),
        ({"touches": True}, "the tip touches"),
        ({"free_s": 1.2}, "fewer than 2 beats"),
    ],
)
def test_inertia_that_cannot_be_known_later_is_not_removed(change: dict[str, float], said: str) -> None:
    stamps, force, _ = log(**change)  # type: ignore[arg-type]
    free = (0.0, min(FREE_S, change.get("free_s", FREE_S)))
    tare, inertia = find_tare_and_inertia(stamps, force, STILL, free, [], MASS_KG)
    assert (inertia.how, inertia.beat_hz) == ("none", 0.0)
    assert said in inertia.detail
    assert inertia_left(stamps, force, STILL, tare, inertia) > 8e-3


def test_a_sensor_that_stands_still_has_no_inertia() -> None:
    stamps, force, carried = log()
    assert find_tare_and_inertia(stamps, force - carried, STILL, (0.0, 5.0), [], MASS_KG)[1].how == "none"
    assert find_tare_and_inertia(stamps, force, STILL, (0.0, 5.0), [], 0.0)[1].how == "none"


@pytest.mark.parametrize("fps", [24.0, 200.0])
def test_the_tips_acceleration_is_that_of_its_movement_in_the_images(fps: float) -> None:
    rng = np.random.default_rng(0)
    seconds = np.arange(0.0, 20.0, 1.0 / fps)
    turns, scale = 2.0 * np.pi * BEAT_HZ * seconds, 1e-4
    moved = AMPLITUDE_M * np.sin(turns) / scale + rng.normal(0.0, 0.2, len(seconds))
    shapes = [
        DetectedShape(Status.VALID, centreline=CentrelinePx(np.array([[0.0, 0.0], [50.0, 0.5 * v], [100.0, v]])))
        for v in moved
    ]
    shapes[50] = DetectedShape(Status.NO_CATHETER)
    found = tip_acceleration(np.rint(seconds * 1e9).astype(np.int64), shapes, scale)
    assert found == pytest.approx(AMPLITUDE_M * (2.0 * np.pi * BEAT_HZ) ** 2 / np.sqrt(2.0), rel=0.05)
    assert tip_acceleration(np.empty(0, np.int64), [], scale) == 0.0
