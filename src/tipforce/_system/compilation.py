"""Compilation of hot loops, and the cache of compiled code on disk."""

import functools
import logging
import time
from collections.abc import Callable, Set
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event

STEADY = {"nnan", "ninf", "nsz"}
"""Options of fast mathematics that change no result. With the others a loop may round differently when it is compiled
than when it comes from the cache, and then the same seed would not give the same bytes."""


def compiled_together(files: str, pattern: str, fastmath: Set[str] = frozenset()) -> Callable[..., Any]:
    """Returns a decorator that compiles a kernel.

    Compiled code is kept on disk between runs. The cached code of one file contains the inlined code of others, but
    numba looks at the date of that one file only. So the cache is stamped with the dates of all files that may be
    inlined.

    Args:
        files: path of a module (its ``__file__``); the files are in the same folder.
        pattern: pattern of their names.
        fastmath: options of fast mathematics, see `STEADY`.
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


MIN_LOGGED_S = 1.0
"""Compilation that takes less time than this is not logged."""
LOG_PERIOD_S = 5.0


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
        since, least = (self._logged_s, LOG_PERIOD_S) if self._logged_s else (self._began_s, MIN_LOGGED_S)
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
