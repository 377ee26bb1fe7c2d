"""The branch of equilibria to which a shape belongs, in the plane and in space."""

from enum import IntEnum


class Branch(IntEnum):
    """How a shape is connected with the unloaded one. Above the buckling load one load has several equilibria."""

    UNLOADED = 0
    """Reached from the unloaded shape by raising all loads together, without a jump."""
    FALLEN = 1
    """This path ends at a fold before the whole load is applied; the rod jumped from there to this shape."""
    GIVEN = 2
    """Reached from a given start; it is the equilibrium next to that start. Its branch was not determined."""
