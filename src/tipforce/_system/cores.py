"""Number of processor cores that may be used."""

import os

from ..errors import InputError

CORES = "TIPFORCE_CORES"
"""Environment variable with the number of cores to use, for a machine that others work on too."""
MAX_CORES = 1024


def cores() -> int:
    """Returns the number of cores to use: as `CORES` states, by default all that this process may run on.

    Raises:
        InputError: `CORES` is no whole number from 1 to 1024.
    """
    stated = os.environ.get(CORES)
    if stated is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not (stated.isdecimal() and 1 <= int(stated) <= MAX_CORES):
        raise InputError(f"{CORES}={stated}: expected a whole number from 1 to {MAX_CORES}")
    return int(stated)
