"""The Kirchhoff rod in space: static equilibria under loads, and contact with a soft wall, instant by instant."""

from ._contact import SpatialContact, SpatialPress, SpatialWall, damping_of_loss_factor, press_spatial
from ._contact_derivatives import ContactDerivatives, contact_derivatives
from ._rod import SpatialRod
from ._statics import SpatialShape, bend_spatial

__all__ = [
    "ContactDerivatives",
    "SpatialContact",
    "SpatialPress",
    "SpatialRod",
    "SpatialShape",
    "SpatialWall",
    "bend_spatial",
    "contact_derivatives",
    "damping_of_loss_factor",
    "press_spatial",
]
