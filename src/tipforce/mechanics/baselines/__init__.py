"""The models that thesis chapter 2 and table 2 compare with, behind one face, each with its known failures."""

from ._constant_curvature import ConstantCurvature
from ._elastica import Elastica
from ._face import Bent, BentShape, RodModel
from ._large_deflection import LargeDeflection
from ._linear_beam import LinearBeam
from ._mass_spring import MassSpring
from ._pseudo_rigid_body import PseudoRigidBody
from ._rigid_links import RigidLinks

__all__ = [
    "Bent",
    "BentShape",
    "ConstantCurvature",
    "Elastica",
    "LargeDeflection",
    "LinearBeam",
    "MassSpring",
    "PseudoRigidBody",
    "RigidLinks",
    "RodModel",
]
