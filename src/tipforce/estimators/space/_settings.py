"""Settings of the model of the rod in space."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from ...types import DEFAULT_VIEW
from ...vision import VisionSettings
from ..session import OverTimeSettings, RodPriors

_Positive = Annotated[float, Field(gt=0, le=1e6)]
_Share = Annotated[float, Field(gt=0, lt=0.5)]
_Degrees = Annotated[float, Field(gt=0, le=90)]


class SpacePriors(RodPriors):
    """Standard deviations before a session begins, about the values of its metadata, or about zero.

    Uncertainties that the metadata state hold in place of the values here.
    """

    stiffness_left_out: _Share = 0.025
    """Relative deviation from a stiffness that was measured well: the shaft creeps."""
    curvature_per_m: _Positive = 0.25
    """Curvature without load in the plane of bending, besides that of the knob."""
    unknown_curvature_per_m: _Positive = 10.0
    """The same where there is no knob, or no map for it."""
    out_of_plane_per_m: _Positive = 3.5
    """Curvature without load out of the plane of bending."""
    base_position_m: _Positive = 0.01
    """Position of the clamp, in each direction."""
    base_angle_deg: _Degrees = 5.0
    """Direction of the clamp's tangent in the image of the first view, from that of the first detected line."""
    base_tilt_deg: _Degrees = 5.0
    """Angle of the clamp's tangent out of that image, where one view alone is there."""
    base_roll_deg: _Degrees = 3.5
    """Angle of the plane of bending about the clamp's tangent, from that image."""
    view_shift_px: _Positive = 0.4
    """Shift of an image by the error of its projection."""
    view_stretch: _Share = 0.002
    """Relative, of scale and shear of an image, and its turn in radians."""
    view_scale: _Share = 0.02
    """Relative, of the scale of a view without a stated projection."""


class SpaceSettings(OverTimeSettings):
    """Force in space by a model of the whole session, from the centrelines of one view or two."""

    views: tuple[str, ...] = (DEFAULT_VIEW,)
    """One view, or two; the first sets the frame rate. The base frame's z axis points to the camera of the first."""
    vision: VisionSettings = VisionSettings()
    """Detection in each view; its own ``view`` does not count."""
    prior: SpacePriors = SpacePriors()
    segments: Annotated[int, Field(ge=8, le=200)] = 24
    """Number of segments of the flexible length."""
    xray_noise: Annotated[float, Field(ge=0.1, le=100)] = 1.0
    """Factor on the errors across lines in X-ray images that vision states; else on measured ones, see `LineError`."""
    one_view_noise: Annotated[float, Field(ge=1, le=100)] = 3.0
    """Further factor on them where one view alone shows the rod: errors of the model in its depth appear as noise. In
    two sessions of `fluoro` 90 % intervals of the magnitude held 74 % with 1, 96 % with 3 (docs/results/two-views.md).
    """
    curvature_walk_per_m: Annotated[float, Field(ge=0, le=1e6)] = 0.1
    """Random walk of the curvatures without load in a second: the shaft creeps."""
    base_walk_deg: Annotated[float, Field(ge=0, le=90)] = 0.3
    """Random walk of the clamp's direction and of the plane of bending in a second. With 0.02 the 90 % intervals of fz
    held 59 % at contact angles from 60 degrees on, with 0.3 they held 95 % (six simulated `biplane` sessions)."""
    force_rate_n_per_s: _Positive = 1.0
    """Standard deviation of the rate of each component of the force, where a view showed one line only so far."""
    force_acceleration_n_per_s2: _Positive = 10.0
    """Standard deviation of the acceleration of each component of the force: by it the line of a view is unsure that
    shows no image of an instant, as with views exposed in turn."""

    @model_validator(mode="after")
    def _one_view_or_two(self) -> Self:
        if not 1 <= len(self.views) <= 2 or len(set(self.views)) != len(self.views):
            raise ValueError(f"expected one view or two different ones, got {list(self.views)}")
        return self

    def vision_of(self, view: str) -> VisionSettings:
        """Returns the settings of the detection in ``view``; lines with a hidden tip are read."""
        return self.vision.model_copy(update={"view": view}).with_hidden_tips()
