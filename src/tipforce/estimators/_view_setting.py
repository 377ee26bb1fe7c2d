"""The setting of a method that names the view it reads, such as ``vision.view``."""

from typing import TypeVar

from pydantic import BaseModel

M = TypeVar("M", bound=BaseModel)


def is_stated(settings: BaseModel, key: str) -> bool:
    """Returns whether a person, or the training of a saved model, chose the value of a setting.

    Args:
        settings: the settings of a method.
        key: the setting, as in ``vision.view``.
    """
    *parents, leaf = key.split(".")
    for parent in parents:
        settings = getattr(settings, parent)
    return leaf in settings.model_fields_set


def with_value(settings: M, key: str, value: str) -> M:
    """Returns ``settings`` with a stated value of one setting.

    Args:
        settings: the settings of a method.
        key: the setting, as in ``vision.view``.
        value: its value.
    """
    first, _, rest = key.partition(".")
    changed = with_value(getattr(settings, first), rest, value) if rest else value
    return settings.model_copy(update={first: changed})
