"""The simulated fluoroscope: from a catheter's shape in space to X-ray images, in one view or two."""

from ._dicom import RESEARCH_NOTE, write_dicom
from ._renderer import Pulse, XrayRenderer
from ._scene import Anatomy, CatheterConstruction, Detector, Instrument, Rhythm, XrayBeam, XrayScene, XrayView
from ._scene_settings import BIPLANE, BIPLANE_VARIED, FLUORO, FLUORO_VARIED, XrayRanges, sample_xray_scene

__all__ = [
    "BIPLANE",
    "BIPLANE_VARIED",
    "FLUORO",
    "FLUORO_VARIED",
    "RESEARCH_NOTE",
    "Anatomy",
    "CatheterConstruction",
    "Detector",
    "Instrument",
    "Pulse",
    "Rhythm",
    "XrayBeam",
    "XrayRanges",
    "XrayRenderer",
    "XrayScene",
    "XrayView",
    "sample_xray_scene",
    "write_dicom",
]
