"""The model-based methods of thesis table 2: the force by a rod model's mechanics."""

from ._estimator import RodModelEstimator, RodModelFacts, RodModelSettings
from ._inverse import STATIONS, StationNoise, fit_force, model_stations
from ._models import Arcs, Beam, Elastica, Links, MassSprings, PseudoRigid, StrainArcs

__all__ = [
    "STATIONS",
    "Arcs",
    "Beam",
    "Elastica",
    "Links",
    "MassSprings",
    "PseudoRigid",
    "RodModelEstimator",
    "RodModelFacts",
    "RodModelSettings",
    "StationNoise",
    "StrainArcs",
    "fit_force",
    "model_stations",
]
