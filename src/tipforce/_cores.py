"""How much of the machine may be used."""

import os

__all__ = ["cores"]


def cores() -> int:
    """Processor cores that this process may run on, at least one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
