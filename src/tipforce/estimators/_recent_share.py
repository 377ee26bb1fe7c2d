"""How often something has been so in the session so far, the last moments weighing most."""

import math


class RecentShare:
    """Share of the frames so far that something was true of, each remembered for ``memory_s``; 1 before the first.

    >>> share = RecentShare(2.0)
    >>> share.add(False, 2.0)
    >>> round(share.value, 2)
    0.37
    """

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self.value = 1.0

    def add(self, so: bool, elapsed_s: float) -> None:
        """The next frame, ``elapsed_s`` after the one before."""
        forgets = math.exp(-elapsed_s / self._memory_s)
        self.value = forgets * self.value + (1.0 - forgets) * so
