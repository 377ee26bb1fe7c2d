"""Statics of the planar catheter: large bending under a tip load, and the tip's contact with a compliant wall."""

from ._contact import Contact, Wall, press
from ._free import Shape, bend
from ._rod import Rod

__all__ = ["Contact", "Rod", "Shape", "Wall", "bend", "press"]
