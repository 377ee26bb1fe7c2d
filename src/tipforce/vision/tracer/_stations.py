"""The array of stations that the tracer fills, and the codes in it.

A station is one short profile across the shaft at which both flanks were measured. The array has one row for each
station, from the base to the tip, and the columns below.
"""

import numpy as np

from ._pixels import fast

U, V, ARC, WIDTH, WEIGHT, KIND = range(6)
"""Columns: position of the centre in px, arc length in px, width in px, weight in the fit, kind."""

NONE = 0
"""No pair of flanks was found; such a place never becomes a station."""
SHAFT = 1
"""Both flanks have the shaft's contrast."""
OTHER = 2
"""The flanks are parallel but have other grey levels, as on metal."""
TAPER = 3
"""The pair is narrower than the shaft, as at a tip."""
PALE = 4
"""The flanks have less than half of the shaft's contrast."""

END_TIP = 0
"""The trace ended because no more flanks were found: the shaft ends here."""
END_BORDER = 1
"""The trace ended at the border of the searched region."""
END_LOST = 2
"""The trace ended because the shaft continues behind a gap that is longer than allowed."""
END_SHORT = 3
"""The trace ended after a few stations: this is no shaft."""


@fast
def add_station(stations: np.ndarray, n: int, u: float, v: float, arc: float, half_width: float, weight: float) -> int:
    """Appends a station that was found beyond the trace.

    Args:
        stations: (k, 6) array of stations; row ``n`` is filled.
        n: number of stations so far.
        u: position of the centre in px.
        v: position of the centre in px.
        arc: arc length from the base line in px.
        half_width: half of the shaft's width in px.
        weight: weight in the fit, 0 to 1.

    Returns:
        The new number of stations, n + 1.
    """
    stations[n, U] = u
    stations[n, V] = v
    stations[n, ARC] = arc
    stations[n, WIDTH] = 2.0 * half_width
    stations[n, WEIGHT] = weight
    stations[n, KIND] = OTHER
    return n + 1
