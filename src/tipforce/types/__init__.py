"""The few things that travel between the rooms. SI units; stamps are integer nanoseconds at mid-exposure.

Image coordinates: u right, v down, pixel centres at integers. Base frame: origin at the base, x along the base tangent
toward the tip, y 90 degrees counter-clockwise from x as seen in the displayed picture, z toward the camera.
Force = what the tissue does to the tip, in the base frame.
"""

from ._arrays import BoolArray, FloatArray, Image, IntArray, frozen
from ._axes import ADVANCE, KNOB, STAGE_ACROSS, STAGE_FORWARD, AxisLimits, Commanded, refuse_unknown
from ._device import BASE_SIDE, BASE_SIDES, CATHETER_FACTS, KNOB_GAIN, Catheter, Context
from ._estimate import ForceEstimate, Status
from ._seams import Actuators, Clock, SimulatedClock, Source, SystemClock
from ._shape import BasePose, CentrelineM, CentrelinePx
from ._streams import JOINTS, STAGE, Actuation, Event, Frame, Observation, ShapeFeatures, View, Wrench

__all__ = [
    "ADVANCE",
    "BASE_SIDE",
    "BASE_SIDES",
    "CATHETER_FACTS",
    "JOINTS",
    "KNOB",
    "KNOB_GAIN",
    "STAGE",
    "STAGE_ACROSS",
    "STAGE_FORWARD",
    "Actuation",
    "Actuators",
    "AxisLimits",
    "BasePose",
    "BoolArray",
    "Catheter",
    "CentrelineM",
    "CentrelinePx",
    "Clock",
    "Commanded",
    "Context",
    "Event",
    "FloatArray",
    "ForceEstimate",
    "Frame",
    "Image",
    "IntArray",
    "Observation",
    "ShapeFeatures",
    "SimulatedClock",
    "Source",
    "Status",
    "SystemClock",
    "View",
    "Wrench",
    "frozen",
    "refuse_unknown",
]
