"""The simulated camera: from a catheter's shape in space to the image that a laboratory's camera would take."""

from .._exposure import ImageTruth, TissueHome, TissueState
from ._renderer import CameraRenderer
from ._scene import (
    BackgroundAppearance,
    CameraScene,
    CatheterAppearance,
    Instrument,
    Lamp,
    Lens,
    Lighting,
    Occluder,
    SensorNoise,
    TissueAppearance,
    TubeFinish,
)
from ._scene_settings import BENCH_2021, GENERALISE, THESIS_PLAIN, VARIED, SceneRanges, sample_scene
from ._variety import Framing, SceneVariety

__all__ = [
    "BENCH_2021",
    "GENERALISE",
    "THESIS_PLAIN",
    "VARIED",
    "BackgroundAppearance",
    "CameraRenderer",
    "CameraScene",
    "CatheterAppearance",
    "Framing",
    "ImageTruth",
    "Instrument",
    "Lamp",
    "Lens",
    "Lighting",
    "Occluder",
    "SceneRanges",
    "SceneVariety",
    "SensorNoise",
    "TissueAppearance",
    "TissueHome",
    "TissueState",
    "TubeFinish",
    "sample_scene",
]
