"""Streams brought together: clock offset, tare, inertia, labels at mid-exposure, views of one instant."""

from ..plausibility import MAX_GAP_S
from ._find import ForceCorrections, OffsetChoice, TareChoice, find_offset, find_tare_and_inertia
from ._inertia import StageMotion, fit_inertia
from ._labels import Labels, covered_frames, label_log, labels
from ._observations import PAIR_S, Pairing, nearest_frames, observations
from ._plausible import find_plausible_force
from ._tare import find_tare, stated_tare
from ._tare_check import changing_tare, contact_free_stretch, pulling_force
from ._timing import estimate_offset, shape_coordinates

__all__ = [
    "MAX_GAP_S",
    "PAIR_S",
    "ForceCorrections",
    "Labels",
    "OffsetChoice",
    "Pairing",
    "StageMotion",
    "TareChoice",
    "changing_tare",
    "contact_free_stretch",
    "covered_frames",
    "estimate_offset",
    "find_offset",
    "find_plausible_force",
    "find_tare",
    "find_tare_and_inertia",
    "fit_inertia",
    "label_log",
    "labels",
    "nearest_frames",
    "observations",
    "pulling_force",
    "shape_coordinates",
    "stated_tare",
]
