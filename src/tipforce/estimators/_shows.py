"""An optional addition to the estimators' face: a method that can show the shape it saw."""

from typing import Protocol, runtime_checkable

from ..types import FloatArray, Observation, SessionInfo, ShapeFeatures, Status
from ..vision import (
    DetectedShape,
    NoFeatures,
    ResolvedVision,
    ShapeDetector,
    ShapeFeatureSettings,
    VisionSettings,
    fitted_curve,
    for_session,
    shape_features,
)
from ._base import Estimator

__all__ = ["ShowsShape", "look_with", "view_of"]


@runtime_checkable
class ShowsShape(Protocol):
    """A method that finds a shape in the picture and can show it."""

    def look(self, observation: Observation, info: SessionInfo) -> tuple[DetectedShape, FloatArray | None]:
        """What was seen in a session, and the fitted curve (n, 2) in image points, None where there is none."""
        ...


def look_with(
    vision: VisionSettings | ResolvedVision, features: ShapeFeatureSettings, observation: Observation, info: SessionInfo
) -> tuple[DetectedShape, FloatArray | None]:
    """`ShowsShape.look` for a method that sees by ``vision`` and learns from ``features``."""
    image = observation.views.get(vision.view)
    if image is None or isinstance(image, ShapeFeatures):
        return DetectedShape(Status.MISSING_INPUT, f"there is no picture in the view {vision.view!r}"), None
    detection = for_session(vision, info) if isinstance(vision, ResolvedVision) else vision
    sighting = ShapeDetector(detection).detect(image)
    values = shape_features(sighting, features)
    return sighting, None if isinstance(values, NoFeatures) else fitted_curve(sighting, features, values)


def view_of(estimator: Estimator) -> str:
    """Name of the view whose pictures ``estimator`` sees; the default of `VisionSettings` for one that states none."""
    vision = getattr(estimator.settings, "vision", None)
    if isinstance(vision, VisionSettings):
        return vision.view
    return str(getattr(estimator.settings, "view", VisionSettings().view))
