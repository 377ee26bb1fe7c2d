"""Statics of the catheter, in the plane and in space: large bending under loads, and contact with a soft wall."""

from ._branch import Branch
from ._heart import HEART_WAVES, HeartMotion
from ._line_noise import LineNoise
from ._play import Play
from ._posterior import posterior_covariance, posterior_covariance_along
from .models import (
    ConstantCurvature,
    LargeDeflection,
    LinearBeam,
    MassSpring,
    PolylineShape,
    PseudoRigidBody,
    RigidLinks,
    RodModel,
)
from .planar import PlanarRod
from .spatial import (
    ContactDerivatives,
    SpatialContact,
    SpatialContactSolver,
    SpatialRod,
    SpatialShape,
    SpatialWall,
    contact_derivatives,
    damping_of_loss_factor,
    face_depths,
    solve_static_spatial,
)

__all__ = [
    "HEART_WAVES",
    "Branch",
    "ConstantCurvature",
    "ContactDerivatives",
    "HeartMotion",
    "LargeDeflection",
    "LineNoise",
    "LinearBeam",
    "MassSpring",
    "PlanarRod",
    "Play",
    "PolylineShape",
    "PseudoRigidBody",
    "RigidLinks",
    "RodModel",
    "SpatialContact",
    "SpatialContactSolver",
    "SpatialRod",
    "SpatialShape",
    "SpatialWall",
    "contact_derivatives",
    "damping_of_loss_factor",
    "face_depths",
    "posterior_covariance",
    "posterior_covariance_along",
    "solve_static_spatial",
]
