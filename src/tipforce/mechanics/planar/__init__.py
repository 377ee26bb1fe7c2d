"""The elastica in the plane: static equilibria under loads, and contact with a soft wall."""

from ._contact import Contact, Wall, solve_contact
from ._rod import Rod
from ._statics import Shape, Shapes, solve_static, solve_static_batch

__all__ = ["Contact", "Rod", "Shape", "Shapes", "Wall", "solve_contact", "solve_static", "solve_static_batch"]
