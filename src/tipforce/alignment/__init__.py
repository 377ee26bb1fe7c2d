"""Streams brought together: clock map, tare, inertia, labels at mid-exposure, views of one instant."""

from ..plausibility import MAX_GAP_S
from ._beat import MAX_INERTIA_N, inertia_left
from ._clock import estimate_clock
from ._deflection import shape_coordinates
from ._find import ForceCorrections, TareChoice, find_tare_and_inertia
from ._find_clock import ClockChoice, DetectedShapes, OffsetChoice, find_clock, stated_clock
from ._inertia import StageMotion, fit_inertia, tip_acceleration
from ._labels import Labels, covered_frames, label_log, labels
from ._observations import PAIR_S, ObservationQueue, Pairing, nearest_frames, observations
from ._plausible import find_plausible_force
from ._tare import find_tare, stated_tare
from ._tare_check import changing_tare, contact_free_stretch, pulling_force

__all__ = [
    "MAX_GAP_S",
    "MAX_INERTIA_N",
    "PAIR_S",
    "ClockChoice",
    "DetectedShapes",
    "ForceCorrections",
    "Labels",
    "ObservationQueue",
    "OffsetChoice",
    "Pairing",
    "StageMotion",
    "TareChoice",
    "changing_tare",
    "contact_free_stretch",
    "covered_frames",
    "estimate_clock",
    "find_clock",
    "find_plausible_force",
    "find_tare",
    "find_tare_and_inertia",
    "fit_inertia",
    "inertia_left",
    "label_log",
    "labels",
    "nearest_frames",
    "observations",
    "pulling_force",
    "shape_coordinates",
    "stated_clock",
    "stated_tare",
    "tip_acceleration",
]
