"""The methods by name."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from ..errors import InputError
from ._base import Estimator

__all__ = ["ESTIMATORS", "create"]

ESTIMATORS: dict[str, type[Estimator]] = {}
"""What the command line calls each method -> its class."""


def create(name: str, settings: BaseModel | Mapping[str, Any] | None = None) -> Estimator:
    """An unfitted estimator; ``settings``: the method's own model (``ESTIMATORS[name].settings_type``) or its values.

    Raises InputError for a name that is no method.
    """
    if name not in ESTIMATORS:
        raise InputError(f"there is no estimator {name!r}; there are {', '.join(ESTIMATORS)}")
    raise NotImplementedError(settings)
