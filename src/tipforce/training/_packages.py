"""The extra packages, imported when they are needed. What comes out of them is unknown to the type checker."""

import importlib
from typing import Any

from ..errors import MissingExtraError

__all__ = ["package"]


def package(name: str) -> Any:
    """The module ``name``; raises MissingExtraError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise MissingExtraError((error.name or name).split(".")[0], extra="train") from None
