"""Curves by arc length and their numbers."""

from ._curves import angle_matrix, curve_from_angle, fit_angle, fit_polynomial, turning_angles

__all__ = ["angle_matrix", "curve_from_angle", "fit_angle", "fit_polynomial", "turning_angles"]
