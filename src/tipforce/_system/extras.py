"""Imports packages that are installed only with an extra."""

import importlib
from typing import Any

from ..errors import MissingExtraError


def import_extra(module: str, extra: str, *, package: str = "") -> Any:
    """Imports a module of an optional package. Its contents are unknown to the type checker.

    Args:
        module: full name of the module.
        extra: the extra that installs the package.
        package: name of the package in the message; by default that of the missing module.

    Returns:
        The module.

    Raises:
        MissingExtraError: the package is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(package or (error.name or module).split(".")[0], extra=extra) from None
