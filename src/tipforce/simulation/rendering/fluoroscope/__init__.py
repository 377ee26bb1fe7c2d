"""The twin's fluoroscope: from a catheter's shape in space to X-ray pictures, in one view or two."""

from ._c_arm import CArm
from ._dicom import RESEARCH_NOTE, write_dicom
from ._renderer import Pulse, XrayRenderer
from ._scene import Anatomy, Beam, CatheterMake, Detector, Device, Rhythm, XrayScene, XrayView
from ._scene_settings import BIPLANE, FLUORO, XrayRanges, draw_xray_scene

__all__ = [
    "BIPLANE",
    "FLUORO",
    "RESEARCH_NOTE",
    "Anatomy",
    "Beam",
    "CArm",
    "CatheterMake",
    "Detector",
    "Device",
    "Pulse",
    "Rhythm",
    "XrayRanges",
    "XrayRenderer",
    "XrayScene",
    "XrayView",
    "draw_xray_scene",
    "write_dicom",
]
