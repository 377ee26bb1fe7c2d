"""The twin's camera: from a catheter's shape in space to the picture a laboratory's camera would give."""

from ._compose import TissueState
from ._draw import draw_scene
from ._noise import SensorNoise
from ._phantom import TissueHome
from ._profile import Lamp, TubeFinish
from ._ranges import BENCH_2021, GENERALISE, SceneRanges
from ._renderer import CameraRenderer
from ._scene import (
    CameraScene,
    CatheterLook,
    Cover,
    GroundLook,
    Instrument,
    Lens,
    Lighting,
    TissueLook,
)
from ._truth import PictureTruth

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
