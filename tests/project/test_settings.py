"""Every number that somebody may state, or change in a stored model, has a lower and an upper limit."""

import importlib
import pkgutil
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

import tipforce
from tipforce.estimators import ESTIMATORS


def models() -> list[type[BaseModel]]:
    for module in pkgutil.walk_packages(tipforce.__path__, "tipforce."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    found: list[type[BaseModel]] = []
    left = [BaseModel]
    while left:
        left += (below := left.pop().__subclasses__())
        # messages go out, and facts describe a fitted model: their values were computed, nobody states them
        computed = ("Message", "Facts", "NetworkTraining")
        found += [e for e in below if e.__module__.startswith("tipforce.") and not e.__name__.endswith(computed)]
    return found


def numbers(kind: Any, limits: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Of each int or float in an annotation, what is stated of it."""
    origin = get_origin(kind)
    if origin is Annotated:
        inner, *more = get_args(kind)
        yield from numbers(inner, (*limits, *more))
    elif kind in (int, float):
        yield limits
    elif origin is not Literal:
        for each in get_args(kind):  # limits of a union are those of its members, those of a tuple its length's
            yield from numbers(each, limits if origin in (Union, types.UnionType) else ())


def has(limits: tuple[Any, ...], *names: str) -> bool:
    each = [part for limit in limits for part in (limit.metadata if isinstance(limit, FieldInfo) else [limit])]
    return any(getattr(part, name, None) is not None for part in each for name in names)


def test_every_numeric_setting_has_a_lower_and_an_upper_limit() -> None:
    settings = models()
    assert len(settings) > 20
    open_ended = [
        f"{model.__name__}.{name}"
        for model in settings
        for name, field in model.model_fields.items()
        for limits in numbers(field.annotation, tuple(field.metadata))
        if not (has(limits, "ge", "gt") and has(limits, "le", "lt"))
    ]
    assert open_ended == []


@pytest.mark.parametrize("method", ["svr", "dcfe", "compact", "beam"])
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400", "x" * 10_000, [], {}, None])
def test_no_number_of_a_method_takes_what_is_none(method: str, value: object) -> None:
    kind = ESTIMATORS[method].settings_type
    for name, field in kind.model_fields.items():
        if field.annotation in (int, float):
            with pytest.raises(ValidationError):
                kind.model_validate({name: value})
