"""How much of the machine may be used."""

import os

from ..errors import InputError

CORES = "TIPFORCE_CORES"
"""The environment variable that says how many cores to use, as on a machine that others work on too."""
_MOST = 1024


def cores() -> int:
    """Processor cores to use: as many as `CORES` says, by default all that this process may run on.

    Raises:
        InputError: `CORES` is no whole number from 1 to 1024.
    """
    stated = os.environ.get(CORES)
    if stated is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not (stated.isdecimal() and 1 <= int(stated) <= _MOST):
        raise InputError(f"{CORES}={stated}: expected a whole number from 1 to {_MOST}")
    return int(stated)
