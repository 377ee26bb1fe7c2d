"""Settings of the rod estimators: prior knowledge of a session as standard deviations, and limits of abstention."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ...vision import VisionSettings
from ._posterior import ForcePrior

_Std = Annotated[float, Field(gt=0, le=1e6)]
_Share = Annotated[float, Field(gt=0, lt=0.5)]
_FROZEN = ConfigDict(frozen=True, extra="forbid")


class RodPriors(BaseModel):
    """Priors of shaft and knob, in the plane and in space; see `ConstantPriors`."""

    model_config = _FROZEN

    contact_share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Share of frames in which the tip touches."""
    stiffness: _Share = 0.05
    """Relative, of the bending stiffness that is stated."""
    proximal_stiffness: _Share = 0.05
    """Relative, of the stiffness of the third next to the base beside the rest."""
    stiffening_m2: Annotated[float, Field(ge=0, le=1e-2)] = 4.5e-4
    """Stiffness grows as 1 + this x curvature^2: from 4.3e-4 to 9.2e-4 N m^2 at 50 1/m (Khoshnam et al.)."""
    stiffening_std_m2: _Std = 2e-4
    length: _Share = 0.02
    """Relative, of the flexible length."""
    knob_gain: _Share = 0.02
    """Relative, of the curvature that the knob asks for."""
    knob_play_deg: Annotated[float, Field(ge=0, le=90)] = 1.0
    """Backlash of the knob: the curvature may belong to any angle within half of this."""


class ConstantPriors(RodPriors):
    """Priors of a session before its first image; each is a Gaussian about the value in the session metadata.

    The metadata may state how well they are known: then that holds for stiffness, length, scale and tilt in place of
    the values here, which are those of a bench of which nothing is said.
    """

    scale: _Share = 0.02
    """Scale of the image (metres of a pixel), relative."""
    precurvature_per_m: _Std = 0.1
    """Curvature without load, besides that of the knob."""
    unknown_precurvature_per_m: _Std = 10.0
    """The same where there is no knob, or no map for it."""
    base_position_m: _Std = 0.01
    """Position of the clamp, from where the shaft enters the image."""
    base_angle_deg: _Std = 1.5
    """Direction of the clamp's tangent, from the perpendicular to the border that the shaft comes from."""
    tilt_per_m: _Std = 0.15
    """Tilt of the camera, each way: tangent of the angle over the camera's distance."""
    distortion_per_m2: _Std = 0.3
    """Radial distortion of the lens: k1 over the square of the camera's distance."""
    creep: Annotated[float, Field(ge=0, lt=0.5)] = 0.02
    """Share by which the bend grows under a steady force; a polymer shaft has some percent."""
    creep_std: _Share = 0.02


class PriorSettings(ConstantPriors):
    """Priors of `rod` and `rod-track`: those of the constants, and of the force."""

    force_n: _Std = 0.25
    """Each component of the force in contact, in the fit of the rod."""
    force_scale_n: _Std = 0.12
    """Scale of the force's distribution in contact, a bivariate Student's. Forces that pull at the tip are excluded."""
    force_freedom: _Std = 3.0
    """Its degrees of freedom: so few that it has a heavy tail, which draws no large force to the usual ones."""

    def of_force(self) -> ForcePrior:
        """The prior of the force."""
        return ForcePrior(self.force_n, self.force_scale_n, self.force_freedom)


class NoiseSettings(BaseModel):
    """Error of the detected centreline in px, see `LineNoise`: measured on simulated images of a camera bench."""

    model_config = _FROZEN

    fresh_px: _Std = 0.027
    """Across the line, new in each frame."""
    fresh_tip_px: _Std = 0.4
    fresh_along_px: _Std = 1.0
    """Error of the tip along the line."""
    lasting_px: _Std = 0.05
    """The same that stay for a session."""
    lasting_tip_px: _Std = 0.25
    lasting_along_px: _Std = 1.5
    factor: Annotated[float, Field(ge=0.1, le=100)] = 1.2
    """Factor on all of them: effects that the planar rod lacks (depth, creep) appear as noise."""
    max_level: Annotated[float, Field(ge=1, le=100)] = 10.0
    """Largest ratio of the noise across the line, found in the session, to the stated one. Beyond it, abstains."""
    level_s: _Std = 5.0
    """How long the level of the noise is remembered (`rod-track`)."""
    level_frames: _Std = 5.0
    """Weight of the stated level, in frames."""


class RodFitSettings(BaseModel):
    """Settings of every method that fits a rod to centrelines, in the plane or in space."""

    model_config = _FROZEN

    noise: NoiseSettings = NoiseSettings()
    huber: _Std = 4.0
    """Number of standard deviations up to which misfits count with their square; beyond it, with their size."""
    max_misfit: _Std = 2.0
    """Abstains where the mean square misfit of the rod is larger, in the noise's variances."""
    max_error_n: Annotated[float, Field(gt=0, le=100)] | None = None
    """Abstains where the 90 % interval of the magnitude reaches further than this from the estimate."""
    max_precurvature_per_m: _Std = 60.0
    """Abstains where the knob asks for more."""


class LineSettings(RodFitSettings):
    """Settings of every method that fits a rod to the centreline in one view."""

    vision: VisionSettings = VisionSettings()
    prior: ConstantPriors = ConstantPriors()
    learn: bool = True
    """Whether `fit` learns priors from sessions with forces: stiffness, knob, clamp, camera, noise and the
    distribution of forces. Without it the settings hold."""
    segments: Annotated[int, Field(ge=8, le=400)] = 40
    """Number of segments of the flexible length."""


class RodSettings(LineSettings):
    """Force by the rod's mechanics from one centreline and the actuation."""

    prior: PriorSettings = PriorSettings()  # pyright: ignore[reportIncompatibleVariableOverride] (frozen)
    max_off: _Std = 2.1
    """Abstains where a session's constants are further from their priors, mean square in the priors' variances: for 13
    constants chance exceeds this in 1 % (chi-squared)."""
    max_std_n: _Std = 1.2
    """Abstains where the image alone leaves a direction of the force open by more than this."""
    sure_n: _Std = 0.3
    """Where the force is known worse than this in some direction, evidence against contact counts less than half: a
    push along the axis of a straight shaft looks like none."""


class RodTrackSettings(RodSettings):
    """Force by the rod's mechanics from all centrelines so far."""

    prior: PriorSettings = PriorSettings(force_scale_n=0.2)
    force_rate_n_per_s: _Std = 2.0
    """How fast the force changes in contact."""
    force_rate_s: _Std = 0.3
    """How long it goes on changing so."""
    force_s: _Std = 0.4
    """How long a force is remembered: later it is anything within ``prior.force_n``."""
    contact_s: _Std = 0.5
    """Mean time in contact, and without."""
    knob_drift: _Std = 0.01
    """Relative slow drift of the knob's curvature, with the time constant ``knob_drift_s``."""
    knob_drift_s: _Std = 20.0
    base_walk_m: Annotated[float, Field(ge=0, le=1)] = 2e-5
    """Random walk of the clamp's position in a second, and, in degrees, of its direction."""
    base_walk_deg: Annotated[float, Field(ge=0, le=90)] = 0.02
    advance_late_s: Annotated[float, Field(ge=0, le=1)] = 5e-3
    """Standard deviation of the time between an image and the reading of the clamp's advance that belongs to it."""
    constants_s: _Std = 20.0
    """How long stiffness, length, scale, camera and creep are remembered: the line's errors stay alike from frame to
    frame, so that many frames have less information on them than independent ones."""
    line_error_s: _Std = 10.0
    """How long the lasting error of the line stays: effects that a planar rod lacks change with the load."""
    creep_s: _Std = 2.0
    """Time constant of the shaft's creep."""
    sure_n: _Std = 0.1
    max_off: _Std = 5.0
    """As of `RodSettings`; more is usual than by chance, since the line's errors last longer than their model says."""
    min_explained: Annotated[float, Field(ge=0, le=1)] = 0.8
    """Abstains where the rod explained a smaller share of the recent frames (time constant ``explained_s``): the
    detected object is then another one, and a single line fits by chance."""
    explained_s: _Std = 2.0
    gap_s: _Std = 1.0
    """After so long without a frame nothing is known of the force."""
