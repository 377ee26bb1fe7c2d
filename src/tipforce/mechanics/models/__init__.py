"""The rod models that thesis chapter 2 and table 2 compare, with one interface, each with its known failures."""

from ._beams import LargeDeflection, LinearBeam
from ._chain_models import ConstantCurvature, MassSpring, RigidLinks
from ._interface import PolylineShape, RodModel
from ._pseudo_rigid_body import PseudoRigidBody

__all__ = [
    "ConstantCurvature",
    "LargeDeflection",
    "LinearBeam",
    "MassSpring",
    "PolylineShape",
    "PseudoRigidBody",
    "RigidLinks",
    "RodModel",
]
