"""Finds methods, drivers and layouts by their names: those of tipforce and those that other packages add.

A package adds one by an entry point (``importlib.metadata``). Its ``pyproject.toml`` states, for example::

    [project.entry-points."tipforce.estimators"]
    ridge = "tipforce_ridge:Ridge"

Those of tipforce are listed here as the same name and value, so that they are found without an installation, too.
Each is imported when it is first requested: a package that cannot be imported does not affect the others.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from ..errors import InputError

_T = TypeVar("_T")


class Registry(Mapping[str, _T], Generic[_T]):
    """Name -> the registered object, loaded on first use.

    Args:
        group: the group of the entry points.
        noun: a word for such an object, such as "method".
        own: those of tipforce: name -> ``module:attribute``, or ``module``.
        kind: base class of all of them; None: they need not be classes.
    """

    def __init__(self, group: str, noun: str, own: Mapping[str, str], kind: type | None = None) -> None:
        self.group, self.noun, self._own, self._kind = group, noun, own, kind
        self._loaded: dict[str, _T] = {}

    @cached_property
    def _points(self) -> dict[str, list[EntryPoint]]:
        """Name -> its entry points, of which there should be one."""
        found = {name: [EntryPoint(name, value, self.group)] for name, value in self._own.items()}
        for point in entry_points(group=self.group):
            found.setdefault(point.name, []).append(point)
        return found

    def __getitem__(self, name: str) -> _T:
        if name not in self._loaded:
            self._loaded[name] = self._load(self._points[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**self._points, **self._loaded})

    def __len__(self) -> int:
        return len({**self._points, **self._loaded})

    def __contains__(self, name: object) -> bool:
        return name in self._loaded or name in self._points

    def _load(self, points: list[EntryPoint]) -> _T:
        first, *others = points
        if others:
            owners = " and ".join(_package(point) for point in points)
            raise InputError(f"{owners} both have a {self.noun} {first.name!r}; uninstall one of the packages")
        try:
            found = first.load()
        except Exception as error:
            if first.dist is None:
                raise
            raise InputError(
                f"the {self.noun} {first.name!r} of the package {_package(first)} cannot be loaded from {first.value} "
                f"({type(error).__name__}: {error}); repair the package, or uninstall it"
            ) from error
        if self._kind is not None and not (isinstance(found, type) and issubclass(found, self._kind)):
            raise InputError(
                f"the {self.noun} {first.name!r} of the package {_package(first)}: {first.value} is no class derived "
                f"from {self._kind.__name__}"
            )
        return found  # type: ignore[no-any-return]


def _package(point: EntryPoint) -> str:
    return "tipforce" if point.dist is None else f"{point.dist.name} {point.dist.version}"
