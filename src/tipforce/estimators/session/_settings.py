"""Settings of the session model."""

from typing import Annotated

from pydantic import Field

from ..rod import ConstantPriors, LineSettings

_Positive = Annotated[float, Field(gt=0, le=1e6)]


class SessionPriors(ConstantPriors):
    """Priors of the session model: those of a rod in a plane, and of effects that such a rod leaves out."""

    precurvature_per_m: _Positive = 0.2
    """Curvature without load, besides that of the knob; a bend out of the plane looks like it."""
    base_angle_deg: _Positive = 2.5
    """Direction of the clamp's tangent, from the perpendicular to the border that the shaft comes from."""
    largest_force_n: _Positive = 0.8
    """The magnitude of a force in contact is uniform up to this."""
    friction: _Positive = 0.19
    """Friction acts at the surface of the tip's dome, not through its centre. Its lever: this times the radius, one
    standard deviation (root mean square of a friction coefficient between 0.05 and 0.3)."""
    friction_s: _Positive = 0.5
    """How long the lever stays, until the tissue moves the other way."""
    stretch: _Positive = 4e-3
    """A tilted camera shortens one direction of the image and shears it; relative, with a tilt of 5 degrees."""
    depth_per_m: _Positive = 0.065
    """A bend out of the plane moves a point at the distance s from the clamp by this times s^2 in a tilted image."""


class SessionSettings(LineSettings):
    """Force by the model of a whole session: its constants, slow states, and the force of each frame."""

    prior: SessionPriors = SessionPriors()  # pyright: ignore[reportIncompatibleVariableOverride] (frozen)
    update_s: Annotated[float, Field(ge=0, le=60)] = 1.0
    """Time between two frames from which the session's constants are learnt. Errors of the model are the same in
    neighbouring frames, so that all frames have little more information on the constants than one in this time."""
    contact_s: _Positive = 0.5
    """Mean time in contact, and without."""
    knob_drift: _Positive = 0.01
    """Relative slow drift of the knob's curvature, with the time constant ``knob_drift_s``."""
    knob_drift_s: _Positive = 20.0
    base_walk_m: Annotated[float, Field(ge=0, le=1)] = 2e-5
    """Random walk of the clamp's position in a second, and, in degrees, of its direction."""
    base_walk_deg: Annotated[float, Field(ge=0, le=90)] = 0.02
    advance_late_s: Annotated[float, Field(ge=0, le=1)] = 5e-3
    """Standard deviation of the time between an image and the reading of the clamp's advance that belongs to it."""
    line_error_s: _Positive = 10.0
    """How long the lasting error of the line stays."""
    creep_s: _Positive = 2.0
    """Time constant of the shaft's creep."""
    gap_s: _Positive = 5.0
    """After so long without a line that the rod explains, the session's constants are learnt anew."""
