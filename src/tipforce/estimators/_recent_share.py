"""Share of the recent frames of a session that had a property."""

import math


class RecentShare:
    """Exponentially weighted share of the frames that had a property, with time constant ``memory_s``; begins at 1.

    >>> share = RecentShare(2.0)
    >>> share.add(False, 2.0)
    >>> round(share.value, 2)
    0.37
    """

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self.value = 1.0

    def add(self, present: bool, elapsed_s: float) -> None:
        """Updates ``value``, the recent share of frames with a property: an exponential moving average.

        Args:
            present: whether the frame has the property.
            elapsed_s: time since the previous frame.
        """
        retained = math.exp(-elapsed_s / self._memory_s)
        self.value = retained * self.value + (1.0 - retained) * present
