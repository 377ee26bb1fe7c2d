"""Timing ways of doing the same thing against one another, on a machine that does other things too."""

import math
import time
from collections.abc import Callable
from typing import Any

__all__ = ["interleaved"]


def interleaved(ways: dict[str, Callable[[], Any]], blocks: int) -> dict[str, float]:
    """Returns seconds of each way's quickest block; the ways take turns, so that other load affects all of them."""
    best = dict.fromkeys(ways, math.inf)
    for work in ways.values():
        work()  # compiles, and fills the caches
    for _ in range(blocks):
        for name, work in ways.items():
            before = time.perf_counter()
            work()
            best[name] = min(best[name], time.perf_counter() - before)
    return best
