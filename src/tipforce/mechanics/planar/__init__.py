"""The elastica in the plane: static equilibria under loads, contact with a soft wall, and the force from a line."""

from ._cholesky import inverse
from ._contact import Contact, Wall, solve_contact
from ._line_fit import FORCE, UNKNOWNS, Found, Line, Model, Work, fit_line, make_work, predict_line
from ._rod import Rod
from ._statics import Shape, Shapes, solve_static, solve_static_batch

__all__ = [
    "FORCE",
    "UNKNOWNS",
    "Contact",
    "Found",
    "Line",
    "Model",
    "Rod",
    "Shape",
    "Shapes",
    "Wall",
    "Work",
    "fit_line",
    "inverse",
    "make_work",
    "predict_line",
    "solve_contact",
    "solve_static",
    "solve_static_batch",
]
