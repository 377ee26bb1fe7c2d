"""The twin's fluoroscope: from a catheter's shape in space to X-ray pictures, in one view or two."""

from ._carm import CArm
from ._dicom import RESEARCH_NOTE, write_dicom
from ._draw import draw_xray_scene
from ._ranges import BIPLANE, FLUORO, XrayRanges
from ._renderer import Pulse, XrayRenderer
from ._scene import Anatomy, Beam, CatheterMake, Detector, Device, Rhythm, XrayScene, XrayView

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
