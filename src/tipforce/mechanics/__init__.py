"""Statics of the planar catheter: bent shapes under loads, contact with a compliant wall, and what a shape tells."""

from ._contact import Contact, Wall, press
from ._continuation import Branch
from ._derivatives import Derivatives, derivatives
from ._free import Shape, Shapes, bend, bend_many
from ._information import Bound, CentrelineNoise, Information, Priors, cramer_rao, fisher_information
from ._rod import Rod
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
    "Bent",
    "BentShape",
    "Bound",
    "Branch",
    "CentrelineNoise",
    "ConstantCurvature",
    "Contact",
    "Derivatives",
    "Elastica",
    "Hysteresis",
    "Information",
    "KnobMap",
    "LargeDeflection",
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
    "Tendon",
    "Wall",
    "bend",
    "bend_many",
    "cramer_rao",
    "derivatives",
    "fisher_information",
    "press",
]
