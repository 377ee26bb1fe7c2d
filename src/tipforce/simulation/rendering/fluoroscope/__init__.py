"""The simulated fluoroscope: from a catheter's shape in space to X-ray images, in one view or two."""

from ._c_arm import CArm
from ._dicom import RESEARCH_NOTE, write_dicom
from ._renderer import Pulse, XrayRenderer
from ._scene import Anatomy, Beam, CatheterConstruction, Detector, Instrument, Rhythm, XrayScene, XrayView
from ._scene_settings import BIPLANE, FLUORO, XrayRanges, sample_xray_scene

__all__ = [
    "BIPLANE",
    "FLUORO",
    "RESEARCH_NOTE",
    "Anatomy",
    "Beam",
    "CArm",
    "CatheterConstruction",
    "Detector",
    "Instrument",
    "Pulse",
    "Rhythm",
    "XrayRanges",
    "XrayRenderer",
    "XrayScene",
    "XrayView",
    "sample_xray_scene",
    "write_dicom",
]
