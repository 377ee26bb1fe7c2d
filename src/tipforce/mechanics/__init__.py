"""Statics of the planar catheter: large bending under a tip load, and the tip's contact with a compliant wall."""

from ._contact import Contact, Wall, press
from ._free import Shape, bend
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
    "ConstantCurvature",
    "Contact",
    "Elastica",
    "Hysteresis",
    "KnobMap",
    "LargeDeflection",
    "LinearBeam",
    "MassSpring",
    "Play",
    "PrandtlIshlinskii",
    "PseudoRigidBody",
    "RigidLinks",
    "Rod",
    "RodModel",
    "Shape",
    "Tendon",
    "Wall",
    "bend",
    "press",
]
