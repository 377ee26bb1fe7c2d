"""Regressions from the centreline's shape and the drives to the force: one base class for all of them."""

from ._facts import ShapeFacts, TargetFacts
from ._folds import Fold, draw_samples, make_folds
from ._regressor import MIN_SAMPLES, ShapeRegressor, Trained
from ._rows import Rows, gather_rows
from ._settings import AngleSettings, ShapeRegressorSettings, WindowSettings

__all__ = [
    "MIN_SAMPLES",
    "AngleSettings",
    "Fold",
    "Rows",
    "ShapeFacts",
    "ShapeRegressor",
    "ShapeRegressorSettings",
    "TargetFacts",
    "Trained",
    "WindowSettings",
    "draw_samples",
    "gather_rows",
    "make_folds",
]
