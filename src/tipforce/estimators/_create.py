"""The methods by name."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from ..errors import InputError
from ._base import Estimator
from .fusion import Fusion
from .networks import Compact, Dcfe
from .rod import Rod, RodTrack
from .rod_models import Arcs, Beam, Elastica, Links, MassSprings, PseudoRigid, StrainArcs
from .svr import Svr

_ROD_MODELS = (Beam, Links, MassSprings, Elastica, Arcs, StrainArcs, PseudoRigid)

ESTIMATORS: dict[str, type[Estimator]] = {
    kind.name: kind for kind in (Svr, Dcfe, Compact, Rod, RodTrack, Fusion, *_ROD_MODELS)
}
"""What the command line calls each method -> its class."""


def method(name: str) -> type[Estimator]:
    """The class of a method. Raises InputError for a name that is none."""
    if name not in ESTIMATORS:
        raise InputError(f"there is no estimator {name!r}; there are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[name]


def create(name: str, settings: BaseModel | Mapping[str, Any] | None = None) -> Estimator:
    """An unfitted estimator; ``settings``: the method's own model (``ESTIMATORS[name].settings_type``) or its values.

    Raises InputError for a name that is no method; pydantic's ValidationError for values that the model refuses.
    """
    kind = method(name)
    return kind(kind.settings_type.model_validate(settings or {}))  # type: ignore[call-arg]
