"""On which branch of equilibria a shape lies, in the plane and in space."""

from enum import IntEnum


class Branch(IntEnum):
    """How a shape hangs together with the unloaded one. Above the buckling load one load has several equilibria."""

    UNLOADED = 0
    """Reached from the unloaded shape by raising all loads together, without a jump."""
    FALLEN = 1
    """That way ends at a fold before the whole load is on; the rod fell from there on to this shape."""
    GIVEN = 2
    """Reached from a given start, next to which it lies; which branch that is was not looked at."""
