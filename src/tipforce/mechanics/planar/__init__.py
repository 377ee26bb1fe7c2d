"""The elastica in the plane: static equilibria under loads, and contact with a soft wall."""

from ._contact import Contact, Wall, press
from ._rod import Rod
from ._statics import Shape, Shapes, bend, bend_many

__all__ = ["Contact", "Rod", "Shape", "Shapes", "Wall", "bend", "bend_many", "press"]
