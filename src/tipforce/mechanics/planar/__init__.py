"""The elastica in the plane: its equilibrium under a load, and the force from a detected line."""

from ._cholesky import inverse
from ._line_fit import FORCE, UNKNOWNS, Found, Line, Model, Work, fit_line, make_work, predict_line
from ._rod import PlanarRod

__all__ = [
    "FORCE",
    "UNKNOWNS",
    "Found",
    "Line",
    "Model",
    "PlanarRod",
    "Work",
    "fit_line",
    "inverse",
    "make_work",
    "predict_line",
]
