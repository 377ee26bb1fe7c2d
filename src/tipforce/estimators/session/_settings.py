"""Settings of the session model: prior knowledge of a session as standard deviations, and limits of abstention."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ...vision import VisionSettings

_Std = Annotated[float, Field(gt=0, le=1e6)]
_Share = Annotated[float, Field(gt=0, lt=0.5)]
_FROZEN = ConfigDict(frozen=True, extra="forbid")


class RodPriors(BaseModel):
    """Priors of shaft, knob and force, in the plane and in space; see `PriorSettings`."""

    model_config = _FROZEN

    contact_share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Share of frames in which the tip touches."""
    largest_force_n: _Std = 0.8
    """The magnitude of a force in contact is uniform up to this, its direction over all pushes at the tip, with
    friction. Where the shape shows a larger one, there is no answer."""
    friction: _Std = 0.19
    """Friction acts at the surface of the tip's dome, not through its centre. Its lever: this times the radius, one
    standard deviation (root mean square of a friction coefficient between 0.05 and 0.3)."""
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


class PriorSettings(RodPriors):
    """Priors of a session before its first image; each is a Gaussian about the value in the session metadata.

    The metadata may state how well they are known: then that holds for stiffness, length, scale and tilt in place of
    the values here, which are those of a bench of which nothing is said.
    """

    scale: _Share = 0.02
    """Scale of the image (metres of a pixel), relative."""
    precurvature_per_m: _Std = 0.2
    """Curvature without load, besides that of the knob; a bend out of the plane looks like it."""
    unknown_precurvature_per_m: _Std = 10.0
    """The same where there is no knob, or no map for it."""
    base_position_m: _Std = 0.01
    """Position of the clamp, from where the shaft enters the image."""
    base_angle_deg: _Std = 2.5
    """Direction of the clamp's tangent, from the perpendicular to the border that the shaft comes from."""
    tilt_per_m: _Std = 0.15
    """Tilt of the camera, each way: tangent of the angle over the camera's distance."""
    distortion_per_m2: _Std = 0.3
    """Radial distortion of the lens: k1 over the square of the camera's distance."""
    stretch: _Std = 4e-3
    """A tilted camera shortens one direction of the image and shears it; relative, with a tilt of 5 degrees."""
    depth_per_m: _Std = 0.065
    """A bend out of the plane moves a point at the distance s from the clamp by this times s^2 in a tilted image."""
    creep: Annotated[float, Field(ge=0, lt=0.5)] = 0.02
    """Share by which the bend grows under a steady force; a polymer shaft has some percent."""
    creep_std: _Share = 0.02


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
    """Largest ratio of the noise across the line to the stated one. Beyond it, abstains."""
    level_frames: _Std = 5.0
    """Weight of the stated level, in frames."""


class ContactSettings(BaseModel):
    """Use of the network that reads the geometry of the contact from the image at the tip."""

    model_config = _FROZEN

    read: bool = False
    """Whether it is used. It needs an image of a camera in which the tissue is seen."""
    softest_n_per_m: _Std = 15.0
    """Stiffness of the softest tissue."""
    stiffest_n_per_m: _Std = 1000.0
    """Stiffness of the stiffest tissue; its logarithm is uniform between the two."""
    stated_stiffness: _Std = 0.25
    """Relative error of a stiffness of the tissue that the metadata state."""
    law_error: _Std = 0.15
    """Relative error of the law that links depth and force: a tissue gives way more slowly than it is pressed."""
    unreliable_share: _Share = 0.05
    """Probability that a reading is wrong by more than the network says."""
    frames_learnt: Annotated[float, Field(gt=0, le=1e4)] = 2.0
    """All frames of a session teach as much as this number of independent ones: the errors of the shape stay. Chosen on
    seeds 103000 and 104000, on which 1, 3 and 5 were tried."""
    visible_share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Share of sessions in which the tissue is visible."""
    largest_visible_share: Annotated[float, Field(gt=0, lt=1)] = 0.99
    """Largest probability that the tissue of a session is visible, after all its images."""
    odds_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the network's log odds of contact that counts: its errors stay for many frames."""
    largest_log_odds: _Std = 3.0
    """Largest log odds of contact that count."""
    direction_errors_rad: Annotated[tuple[_Std, ...], Field(min_length=1)] = (0.05, 0.15, 0.35, 0.8)
    """Angle between the force and the direction that the network reads, root mean square, by the tissue's friction:
    each of these is as probable."""


class RodFitSettings(BaseModel):
    """Settings of every method that fits a rod to centrelines, in the plane or in space."""

    model_config = _FROZEN

    noise: NoiseSettings = NoiseSettings()
    huber: _Std = 4.0
    """Number of standard deviations up to which misfits count with their square; beyond it, with their size."""
    max_misfit: _Std = 2.0
    """Abstains where the squares of the line's misfit, in the noise's variances, and of the constants' distance from
    their priors, in the priors' variances, are together larger than this for each measurement of the line."""
    max_error_n: Annotated[float, Field(gt=0, le=100)] | None = None
    """Abstains where the 90 % interval of the magnitude reaches further than this from the estimate."""
    max_precurvature_per_m: _Std = 60.0
    """Abstains where the knob asks for more."""


class OverTimeSettings(RodFitSettings):
    """Settings of a model of all centrelines of a session, in the plane or in space."""

    update_s: Annotated[float, Field(ge=0, le=60)] = 1.0
    """Time between two frames from which the session's constants are learnt. Errors of the model are the same in
    neighbouring frames, so that all frames have little more information on the constants than one in this time."""
    level_s: _Std = 5.0
    """How long the level of the line's noise is remembered."""
    contact_s: _Std = 0.5
    """Mean time in contact, and without."""
    friction_s: _Std = 0.5
    """How long the lever of friction stays, until the tissue moves the other way."""
    knob_drift: Annotated[float, Field(ge=0, le=1e6)] = 0.01
    """Relative slow drift of the knob's curvature, with the time constant ``knob_drift_s``."""
    knob_drift_s: _Std = 20.0
    base_walk_m: Annotated[float, Field(ge=0, le=1)] = 2e-5
    """Random walk of the clamp's position in a second."""
    line_error_s: _Std = 10.0
    """How long the lasting error of a line stays."""
    direction_s: Annotated[float, Field(ge=0, le=1e4)] = 20.0
    """How long the direction of the force is remembered, 0: not at all; 10, 20 and 60 s gave nearly the same on seeds
    103000 and 104000."""
    gap_s: _Std = 5.0
    """After so long without a line that the rod explains, the session's constants are learnt anew."""


class RodSettings(RodFitSettings):
    """Force by the session model from one centreline and the actuation."""

    vision: VisionSettings = VisionSettings()
    prior: PriorSettings = PriorSettings()
    learn: bool = True
    """Whether `fit` learns priors from sessions with forces: stiffness, knob, clamp and the share of contact. Without
    it the settings hold."""
    contact: ContactSettings = ContactSettings()
    across_error_n: Annotated[float, Field(ge=0, le=1)] = 0.006
    """Standard deviation of the force across the chord that is added for an answer: lasting errors of the detected line
    and of the model that no constant explains; 0, 3 and 6 mN were tried."""
    segments: Annotated[int, Field(ge=8, le=400)] = 40
    """Number of segments of the flexible length."""


class RodTrackSettings(RodSettings, OverTimeSettings):
    """Force by the session model from all centrelines so far."""

    base_walk_deg: Annotated[float, Field(ge=0, le=90)] = 0.02
    """Random walk of the clamp's direction in a second."""
    advance_late_s: Annotated[float, Field(ge=0, le=1)] = 5e-3
    """Standard deviation of the time between an image and the reading of the clamp's advance that belongs to it."""
    creep_s: _Std = 2.0
    """Time constant of the shaft's creep."""
