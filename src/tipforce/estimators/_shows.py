"""An optional addition to the estimators' face: a method that can show the shape it saw."""

from typing import Protocol, runtime_checkable

from ..types import FloatArray, Observation
from ..vision import Sighting

__all__ = ["ShowsShape"]


@runtime_checkable
class ShowsShape(Protocol):
    """A method that finds a shape in the picture and can show it."""

    def look(self, observation: Observation) -> tuple[Sighting, FloatArray | None]:
        """What was seen, and the fitted curve (n, 2) in image points, None where there is none."""
        ...
