"""The rule by which settings that name a view meet the views of the data."""

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

from ..errors import InputError
from ._seams import Source

DEFAULT_VIEW = "camera"
"""Name of the view of a bench with one camera, and of every video, DICOM file and folder of images."""


@runtime_checkable
class _HasViews(Protocol):
    @property
    def views(self) -> Iterable[str]: ...


def ordered_views(names: Iterable[str]) -> tuple[str, ...]:
    """Returns the names of views without repetition: the default view first, then the others by name.

    >>> ordered_views(["side", "b", "camera"])
    ('camera', 'b', 'side')
    """
    return tuple(sorted(set(names), key=lambda name: (name != DEFAULT_VIEW, name)))


def views_of(source: Source) -> tuple[str, ...]:
    """Returns the names of the views of a source, the first one first; empty where neither it nor its metadata do."""
    return ordered_views(source.views if isinstance(source, _HasViews) else source.session_info.views)


def chosen_view(view: str, there: Iterable[str], *, stated: bool) -> str:
    """Returns the view that is read where settings name one view.

    Args:
        view: the view of the settings.
        there: views of the data, the first one first; empty where they are not known.
        stated: whether a person or a training chose ``view``; otherwise it is the default, and where the data do not
            have it their first view is read.

    Raises:
        InputError: ``view`` was chosen, and the data do not have it.

    >>> chosen_view("camera", ("a", "b"), stated=False)
    'a'
    """
    names = tuple(there)
    if not names or view in names:
        return view
    if stated:
        raise InputError(missing_views([view], names))
    return names[0]


def views_text(names: Iterable[str]) -> str:
    """Returns the names of views in words.

    >>> views_text(["a"]), views_text(["a", "b"])
    ('the view a', 'the views a and b')
    """
    *others, last = names
    return f"the views {', '.join(others)} and {last}" if others else f"the view {last}"


def missing_views(lacking: Iterable[str], there: Iterable[str]) -> str:
    """Returns the sentence that states which views are missing and which there are.

    >>> missing_views(["c"], ["a", "b"])
    "there is no view 'c'; there are a and b"
    """
    names = list(there)
    text = f"there is {names[0]}" if len(names) == 1 else f"there are {', '.join(names[:-1])} and {names[-1]}"
    return f"there is no view {' and no view '.join(repr(name) for name in lacking)}; {text}"
