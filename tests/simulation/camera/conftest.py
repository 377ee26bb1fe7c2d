"""Scenes with nothing in them but a tube, and shapes whose numbers are known."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from tipforce.simulation.rendering.camera import (
    BackgroundAppearance,
    CameraScene,
    Lighting,
    SceneRanges,
    SensorNoise,
    TubeFinish,
    sample_scene,
)

LENGTH_M = 0.048
GROUND, SHAFT = 190.0, 40.0


def _shape(turning_rad: float, nodes: int = 61, out_of_plane: float = 0.0) -> np.ndarray:
    """(1, n, 3): an arc that turns by ``turning_rad`` from base to apex; ``out_of_plane``: 1/m, towards the camera."""
    s = np.linspace(0.0, LENGTH_M, nodes)
    if abs(turning_rad) < 1e-9:
        flat = np.stack([s, np.zeros(nodes)], axis=1)
    else:
        radius = LENGTH_M / turning_rad
        flat = radius * np.stack([np.sin(s / radius), 1 - np.cos(s / radius)], axis=1)
    return np.concatenate([flat, 0.5 * out_of_plane * s[:, None] ** 2], axis=1)[None]


def _plain(**lens: float) -> CameraScene:
    """A grey scene whose ground and shaft have one level each; ``lens``: changes of the drawn one."""
    scene = sample_scene(SceneRanges(colour=False, objects=(0, 0), wear=(0.0, 0.0)), np.random.default_rng(1))
    flat = TubeFinish((SHAFT,) * 3, (SHAFT,) * 3, 0.0, 20.0, 0.0, 10.0)
    even = Lighting(1.0, 0.0, 0.0, 0.0, 0.0, (0.5, 0.5), 1.0, (), 0.1)
    return dataclasses.replace(
        scene,
        light=even,
        noise=SensorNoise(0.05, 1.0),
        ground=BackgroundAppearance("board", (GROUND,) * 3, 0.0, 0.0, 20e-3, 0, 0.0),
        catheter=dataclasses.replace(scene.catheter, finish=flat, seam=0.0, rings_m=(), electrode_m=1e-9),
        lens=dataclasses.replace(
            scene.lens, base_at_m=(8e-3, 12e-3), base_turn_rad=math.radians(7.0), **{"sharpest_m": 0.0, **lens}
        ),
    )


@pytest.fixture
def arc() -> Callable[..., np.ndarray]:
    return _shape


@pytest.fixture
def plain() -> Callable[..., CameraScene]:
    return _plain
