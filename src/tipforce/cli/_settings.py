"""``--set key=value``: every setting of a method or preset from the command line, checked by its pydantic model."""

import json
from collections.abc import Sequence
from typing import Annotated, Any, TypeGuard, TypeVar, get_args

import typer
from pydantic import BaseModel, ValidationError

from ..errors import InputError

M = TypeVar("M", bound=BaseModel)

SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="A setting, e.g. vision.base_side=left; may be repeated."),
]


def settings_from(model: type[M], pairs: list[str] | None, base: M | None = None) -> M:
    """Reads settings from the pairs of an option ``--set``.

    Args:
        model: class of the settings.
        pairs: texts "a.b=value"; values are JSON, else text.
        base: settings that the pairs change; by default those of ``model``.

    Returns:
        The changed settings.

    Raises:
        InputError: a key or a value is wrong; the message names the key, the given value and the possible keys.
    """
    values: dict[str, Any] = {} if base is None else base.model_dump(exclude_unset=True)
    for pair in pairs or []:
        key, equals, text = pair.partition("=")
        if not equals:
            raise InputError(
                f"--set {pair}: expected KEY=VALUE, for example --set {next(iter(model.model_fields))}=..."
            )
        section, section_model = values, model
        *parents, leaf = key.split(".")
        for parent in parents:  # "vision.locator.view": the section of "vision", then that of "locator"
            section_model, default = _within(section_model, parent)
            section = section.setdefault(parent, default)
            if not isinstance(section, dict):
                raise InputError(f"--set {pair}: {parent} is a value ({section}) and holds no settings")
        try:
            section[leaf] = json.loads(text)
        except (ValueError, RecursionError):  # no JSON: a text without quotes
            section[leaf] = text
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(_keys(model, first["loc"][:-1]))
            raise InputError(f"--set {key}: there is no such setting; there are {known}") from None
        raise InputError(f"--set {key}={first['input']}: {first['msg']}") from None


def _within(model: type[BaseModel] | None, name: str) -> tuple[type[BaseModel] | None, dict[str, Any]]:
    """Returns the class of the settings in field ``name`` of ``model``, and the values that they have by default.

    None and no values where there is no such field; None where the field is a plain value.
    """
    field = None if model is None else model.model_fields.get(name)
    if field is None:
        return None, {}
    kind = next((each for each in (field.annotation, *get_args(field.annotation)) if _is_model(each)), None)
    default = field.get_default(call_default_factory=True)
    return kind, default.model_dump(exclude_unset=True) if isinstance(default, BaseModel) else {}


def _is_model(kind: Any) -> TypeGuard[type[BaseModel]]:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _keys(model: type[BaseModel], place: Sequence[int | str]) -> list[str]:
    """Returns the names of the settings at ``place``, the keys that lead there."""
    for part in place:
        kind = model.model_fields[str(part)].annotation
        for each in (kind, *get_args(kind)):  # a type with None is a union
            if _is_model(each):
                model = each
    return list(model.model_fields)
