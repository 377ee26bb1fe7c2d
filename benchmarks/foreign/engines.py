"""The engines, which the extra `foreign` installs; their compiled names are unknown to a type checker."""

from importlib import import_module
from typing import Any

from tipforce.errors import MissingExtraError

__all__ = ["engine"]


def engine(name: str) -> Any:
    """The package ``name``. Raises MissingExtraError."""
    try:
        return import_module(name)
    except ModuleNotFoundError:
        raise MissingExtraError(name, extra="foreign") from None
