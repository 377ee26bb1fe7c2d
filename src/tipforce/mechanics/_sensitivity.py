"""How a centreline moves with what it depends on: one form for the plane and for space."""

from dataclasses import dataclass

from ..types import FloatArray

__all__ = ["Derivatives"]


@dataclass(frozen=True, slots=True, eq=False)
class Derivatives:
    """First derivatives of a centreline, (points, D, parameters) each; D = 2 in the plane, 3 in space.

    ``force``: m/N, D of them. ``moment``: m/(N m), at the tip; in space about x, y and z. ``precurvature``: m per 1/m,
    the same all along the shaft; in space of the twist and about y and z of the material frame. ``stiffness``: m per
    N m^2 of the bending stiffness, in space of the torsional one too, their profile kept. ``base``: of the clamp's
    place (D, m/m) and of its rotation (m/rad, in space about x, y and z); the loads keep their directions meanwhile.

    ``arc_m`` (points,), ``centreline_m`` (points, D) and ``tip_axis`` (D,), a unit vector: where they hold.
    """

    arc_m: FloatArray
    centreline_m: FloatArray
    tip_axis: FloatArray
    force: FloatArray
    moment: FloatArray
    precurvature: FloatArray
    stiffness: FloatArray
    base: FloatArray
