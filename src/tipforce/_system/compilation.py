"""How hot loops are compiled and kept on disk."""

import functools
import logging
import time
from collections.abc import Callable, Set
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event

STEADY = {"nnan", "ninf", "nsz"}
"""The liberties of fast mathematics that change no result. The others let a loop round otherwise when it is compiled
anew than when it comes from the cache, and then the same seed would not give the same bytes."""


def compiled_together(files: str, pattern: str, fastmath: Set[str] = frozenset()) -> Callable[..., Any]:
    """A decorator that compiles a kernel of the files beside ``files`` (a module's ``__file__``) named ``pattern``.

    Compiled code is kept on disk between runs. The kept code of one file holds the inlined code of others, but
    numba looks at the date of that one file only: a stamp over all of them makes a change in any count.
    """
    folder = Path(files).parent
    _log_compilation()

    def decorate(function: Callable[..., Any]) -> Any:
        kernel: Any = njit(cache=True, error_model="numpy", nogil=True, fastmath=set(fastmath))(function)
        kept: Any = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
        if hasattr(kept, "_source_stamp"):
            kept._source_stamp = tuple((f.name, f.stat().st_mtime_ns) for f in sorted(folder.glob(pattern)))
        return kernel

    return decorate


_SILENT_S = 1.0
"""Compilation that takes less is not logged."""
_LOG_EVERY_S = 5.0


class _CompilationLog(event.Listener):
    """Logs how many functions numba has compiled: the first use after an installation takes up to a minute longer."""

    def __init__(self) -> None:
        self._log = logging.getLogger("tipforce.compilation")
        self._depth = self._compiled = 0
        self._began_s = self._logged_s = 0.0

    def on_start(self, event: Any) -> None:
        del event
        self._depth += 1
        now = time.monotonic()
        if not self._began_s:
            self._began_s = now
        since, least = (self._logged_s, _LOG_EVERY_S) if self._logged_s else (self._began_s, _SILENT_S)
        if now - since >= least:
            self._logged_s = now
            self._log.info(
                "compiling for this processor, once after an installation: %d functions in %.0f s",
                self._compiled,
                now - self._began_s,
            )

    def on_end(self, event: Any) -> None:
        del event
        self._depth -= 1
        self._compiled += not self._depth


@functools.cache
def _log_compilation() -> None:
    event.register("numba:compile", _CompilationLog())
