"""The elastica in the plane: its equilibrium under a load, and the force from a detected line."""

from ._cholesky import factorise, inverse, solve_in
from ._line import (
    FORCE,
    UNKNOWNS,
    Line,
    Model,
    Work,
    is_possible,
    loaded_point_aside,
    make_work,
    predict_held_line,
    predict_line,
)
from ._line_fit import Found, fit_line
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
    "loaded_point_aside",
    "make_work",
    "predict_held_line",
    "predict_line",
    "solve_in",
]
