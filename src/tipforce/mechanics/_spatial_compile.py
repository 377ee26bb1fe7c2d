"""How the kernels of the spatial rod are compiled and kept on disk."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

__all__ = ["compiled"]

_HERE = Path(__file__).parent


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a kernel; what was compiled is kept on disk between runs.

    The kept code of one file holds the inlined code of others, but numba looks at the date of that one file only:
    a stamp over all files of the spatial rod makes a change in any of them count.
    """
    kernel: Any = njit(cache=True, error_model="numpy", nogil=True)(function)
    kept: Any = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if hasattr(kept, "_source_stamp"):
        kept._source_stamp = tuple((f.name, f.stat().st_mtime_ns) for f in sorted(_HERE.glob("_spatial*.py")))
    return kernel
