"""A choice of rows from all over a series."""

import numpy as np
import numpy.typing as npt


def evenly_spread(count: int, most: int) -> npt.NDArray[np.int64]:
    """Returns the indices of at most ``most`` of ``count`` rows, spread evenly, the first and the last among them.

    >>> evenly_spread(10, 4).tolist()
    [0, 3, 6, 9]
    """
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.int64))
