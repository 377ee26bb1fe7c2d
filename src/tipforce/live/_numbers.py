"""Numbers of the page's JSON: short, and null if they are not known."""

import math


def number(value: float, digits: int = 5) -> float | None:
    """Rounds a number for JSON, which has no NaN and no infinity.

    Args:
        value: the number, in any unit.
        digits: number of decimals.

    Returns:
        The rounded number, or None if ``value`` is not finite.

    >>> number(0.1234567), number(float("nan"))
    (0.12346, None)
    """
    return round(float(value), digits) + 0.0 if math.isfinite(value) else None
