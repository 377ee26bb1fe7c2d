"""One door for everything that yields events from files."""

from collections.abc import Mapping
from pathlib import Path

from ..types import Context, Source

__all__ = ["open_source"]


def open_source(
    path: Path | str, *, actuation: Mapping[str, float] | None = None, context: Context | None = None
) -> Source:
    """A video, a folder of images or a recording as a `Source`; a context manager that can be iterated again.

    ``actuation``: constant values (``knob_deg``) for files that carry none.
    """
    raise NotImplementedError
