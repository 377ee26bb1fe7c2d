"""Statics of the catheter, in the plane and in space: large bending under loads, and contact with a soft wall."""

from ._contact import Contact, Wall, press
from ._contact_derivatives import ContactDerivatives, contact_derivatives
from ._continuation import Branch
from ._derivatives import derivatives
from ._free import Shape, Shapes, bend, bend_many
from ._heart import HEART_WAVES, HeartMotion
from ._information import Bound, CentrelineNoise, Information, Priors, cramer_rao, fisher_information
from ._line_noise import LineNoise
from ._posterior import posterior_covariance, posterior_covariance_along
from ._rod import Rod
from ._sensitivity import Derivatives
from ._spatial_contact import SpatialContact, SpatialPress, press_spatial
from ._spatial_free import SpatialShape, bend_spatial
from ._spatial_rod import SpatialRod
from ._spatial_wall import SpatialWall, damping_of_loss_factor
from .actuation import Hysteresis, KnobMap, Play, PrandtlIshlinskii, Tendon
from .baselines import (
    Bent,
    BentShape,
    ConstantCurvature,
    Elastica,
    LargeDeflection,
    LinearBeam,
    MassSpring,
    PseudoRigidBody,
    RigidLinks,
    RodModel,
)

__all__ = [
    "HEART_WAVES",
    "Bent",
    "BentShape",
    "Bound",
    "Branch",
    "CentrelineNoise",
    "ConstantCurvature",
    "Contact",
    "ContactDerivatives",
    "Derivatives",
    "Elastica",
    "HeartMotion",
    "Hysteresis",
    "Information",
    "KnobMap",
    "LargeDeflection",
    "LineNoise",
    "LinearBeam",
    "MassSpring",
    "Play",
    "PrandtlIshlinskii",
    "Priors",
    "PseudoRigidBody",
    "RigidLinks",
    "Rod",
    "RodModel",
    "Shape",
    "Shapes",
    "SpatialContact",
    "SpatialPress",
    "SpatialRod",
    "SpatialShape",
    "SpatialWall",
    "Tendon",
    "Wall",
    "bend",
    "bend_many",
    "bend_spatial",
    "contact_derivatives",
    "cramer_rao",
    "damping_of_loss_factor",
    "derivatives",
    "fisher_information",
    "posterior_covariance",
    "posterior_covariance_along",
    "press",
    "press_spatial",
]
