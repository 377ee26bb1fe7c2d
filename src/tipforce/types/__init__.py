"""Data types of all packages. SI units; stamps are integer nanoseconds at mid-exposure.

Image coordinates: u right, v down, pixel centres at integers. Base frame: origin at the base, x along the base tangent
toward the tip, y 90 degrees counter-clockwise from x as seen in the displayed image of the first view, z toward its
camera.
Force: from the tissue on the tip, in the base frame.
"""

from ._arrays import BoolArray, FloatArray, Image, IntArray, frozen
from ._axes import ADVANCE, KNOB, STAGE_ACROSS, STAGE_FORWARD, AxisLimits, Commanded, refuse_unknown
from ._bench_edit import edited_bench
from ._bench_file import bench_text, bench_values, info_from_facts, read_bench
from ._estimate import MAX_AGE_S, ForceEstimate, ShapeBeside
from ._ranges import FORCE_RANGE, RANGES, Range, actuation_range
from ._seams import Actuators, Clock, SimulatedClock, Source, SystemClock
from ._session import (
    BASE_SIDES,
    ActuationInfo,
    BagInfo,
    BaseSide,
    Box,
    Catheter,
    DateOrder,
    ForceLogInfo,
    LogInfo,
    Projection,
    Reads,
    SensorInfo,
    SessionInfo,
    StageInfo,
    TissueInfo,
    ViewInfo,
    merged_values,
)
from ._shape import BasePose, CentrelinePx, DetectedShape
from ._status import Status
from ._streams import JOINTS, STAGE, Actuation, Event, Frame, Observation, ShapeFeatures, View, Wrench
from ._views import DEFAULT_VIEW, chosen_view, missing_views, ordered_views, views_of, views_text

__all__ = [
    "ADVANCE",
    "BASE_SIDES",
    "DEFAULT_VIEW",
    "FORCE_RANGE",
    "JOINTS",
    "KNOB",
    "MAX_AGE_S",
    "RANGES",
    "STAGE",
    "STAGE_ACROSS",
    "STAGE_FORWARD",
    "Actuation",
    "ActuationInfo",
    "Actuators",
    "AxisLimits",
    "BagInfo",
    "BasePose",
    "BaseSide",
    "BoolArray",
    "Box",
    "Catheter",
    "CentrelinePx",
    "Clock",
    "Commanded",
    "DateOrder",
    "DetectedShape",
    "Event",
    "FloatArray",
    "ForceEstimate",
    "ForceLogInfo",
    "Frame",
    "Image",
    "IntArray",
    "LogInfo",
    "Observation",
    "Projection",
    "Range",
    "Reads",
    "SensorInfo",
    "SessionInfo",
    "ShapeBeside",
    "ShapeFeatures",
    "SimulatedClock",
    "Source",
    "StageInfo",
    "Status",
    "SystemClock",
    "TissueInfo",
    "View",
    "ViewInfo",
    "Wrench",
    "actuation_range",
    "bench_text",
    "bench_values",
    "chosen_view",
    "edited_bench",
    "frozen",
    "info_from_facts",
    "merged_values",
    "missing_views",
    "ordered_views",
    "read_bench",
    "refuse_unknown",
    "views_of",
    "views_text",
]
