"""The methods by name: those of this program, and those that other packages add."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from .._system.registry import Registry
from ..errors import InputError
from ._base import Estimator

ESTIMATORS: Registry[type[Estimator]] = Registry(
    "tipforce.estimators",
    "method",
    {
        "svr": "tipforce.estimators.svr:Svr",
        "dcfe": "tipforce.estimators.networks:Dcfe",
        "compact": "tipforce.estimators.networks:Compact",
        "stereo": "tipforce.estimators.networks:Stereo",
        "rod": "tipforce.estimators.session:Rod",
        "rod-track": "tipforce.estimators.session:RodTrack",
        "rod-3d": "tipforce.estimators.space:Rod3d",
        "fusion": "tipforce.estimators.fusion:Fusion",
        "beam": "tipforce.estimators.rod_models:Beam",
        "links": "tipforce.estimators.rod_models:Links",
        "mass-spring": "tipforce.estimators.rod_models:MassSprings",
        "elastica": "tipforce.estimators.rod_models:Elastica",
        "arcs": "tipforce.estimators.rod_models:Arcs",
        "strain": "tipforce.estimators.rod_models:StrainArcs",
        "pseudo-rigid": "tipforce.estimators.rod_models:PseudoRigid",
    },
    Estimator,
)
"""The name of each method on the command line -> its class."""


def method(name: str) -> type[Estimator]:
    """Returns the class of a method.

    Raises:
        InputError: there is no method of this name, its class has another name, or the package that adds it cannot be
            imported.
    """
    if name not in ESTIMATORS:
        raise InputError(f"there is no estimator {name!r}; there are {', '.join(ESTIMATORS)}")
    method_type = ESTIMATORS[name]
    if (class_name := getattr(method_type, "name", None)) != name:
        raise InputError(
            f"the method {name!r} is {method_type.__module__}.{method_type.__qualname__}, whose name is "
            f"{class_name!r}; set name = {name!r} in the class, or give the entry point the name of the class"
        )
    return method_type


def create(name: str, settings: BaseModel | Mapping[str, Any] | None = None) -> Estimator:
    """Makes an unfitted estimator.

    Args:
        name: the name of the method.
        settings: an instance of ``ESTIMATORS[name].settings_type``, or some of its values; None: the defaults.

    Raises:
        InputError: there is no method of this name.
        pydantic.ValidationError: the settings refuse a value.
    """
    kind = method(name)
    return kind(kind.settings_type.model_validate(settings or {}))
