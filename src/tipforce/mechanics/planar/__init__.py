"""The elastica in the plane: its equilibrium under a load, and the force from a detected line."""

from ._cholesky import factorise, inverse, solve_in
from ._line_fit import FORCE, UNKNOWNS, Found, Line, Model, Work, fit_line, is_possible, make_work, predict_line
from ._rod import PlanarRod

__all__ = [
    "FORCE",
    "UNKNOWNS",
    "Found",
    "Line",
    "Model",
    "PlanarRod",
    "Work",
    "factorise",
    "fit_line",
    "inverse",
    "is_possible",
    "make_work",
    "predict_line",
    "solve_in",
]
