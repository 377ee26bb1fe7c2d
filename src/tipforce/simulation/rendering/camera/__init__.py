"""The twin's camera: from a catheter's shape in space to the picture a laboratory's camera would give."""

from .._exposure import PictureTruth, TissueHome, TissueState
from ._renderer import CameraRenderer
from ._scene import (
    CameraScene,
    CatheterLook,
    Cover,
    GroundLook,
    Instrument,
    Lamp,
    Lens,
    Lighting,
    SensorNoise,
    TissueLook,
    TubeFinish,
)
from ._scene_settings import BENCH_2021, GENERALISE, SceneRanges, draw_scene

__all__ = [
    "BENCH_2021",
    "GENERALISE",
    "CameraRenderer",
    "CameraScene",
    "CatheterLook",
    "Cover",
    "GroundLook",
    "Instrument",
    "Lamp",
    "Lens",
    "Lighting",
    "PictureTruth",
    "SceneRanges",
    "SensorNoise",
    "TissueHome",
    "TissueLook",
    "TissueState",
    "TubeFinish",
    "draw_scene",
]
