"""How hot loops are compiled and kept on disk."""

from collections.abc import Callable, Set
from pathlib import Path
from typing import Any

from numba import njit

STEADY = {"nnan", "ninf", "nsz"}
"""The liberties of fast mathematics that change no result. The others let a loop round otherwise when it is compiled
anew than when it comes from the cache, and then the same seed would not give the same bytes."""


def compiled_together(files: str, pattern: str, fastmath: Set[str] = frozenset()) -> Callable[..., Any]:
    """A decorator that compiles a kernel of the files beside ``files`` (a module's ``__file__``) named ``pattern``.

    What was compiled is kept on disk between runs. The kept code of one file holds the inlined code of others, but
    numba looks at the date of that one file only: a stamp over all of them makes a change in any count.
    """
    folder = Path(files).parent

    def decorate(function: Callable[..., Any]) -> Any:
        kernel: Any = njit(cache=True, error_model="numpy", nogil=True, fastmath=set(fastmath))(function)
        kept: Any = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
        if hasattr(kept, "_source_stamp"):
            kept._source_stamp = tuple((f.name, f.stat().st_mtime_ns) for f in sorted(folder.glob(pattern)))
        return kernel

    return decorate
