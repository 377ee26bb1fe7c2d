"""The Kirchhoff rod in space: static equilibria under loads, and contact with a soft wall, instant by instant."""

from ._contact import SpatialContact, SpatialContactSolver, SpatialWall, damping_of_loss_factor
from ._contact_derivatives import ContactDerivatives, contact_derivatives
from ._face import face_depths
from ._rod import SpatialRod
from ._shape_slopes import PARAMETERS, SpatialShapes
from ._statics import SpatialShape, solve_static_spatial

__all__ = [
    "PARAMETERS",
    "ContactDerivatives",
    "SpatialContact",
    "SpatialContactSolver",
    "SpatialRod",
    "SpatialShape",
    "SpatialShapes",
    "SpatialWall",
    "contact_derivatives",
    "damping_of_loss_factor",
    "face_depths",
    "solve_static_spatial",
]
