"""Numbers of the page's JSON: short, and null if they are not known."""

import math


def number(value: float, digits: int = 5) -> float | None:
    """Returns ``value`` rounded to ``digits`` decimals, or None if it is not finite.

    >>> number(0.1234567), number(float("nan"))
    (0.12346, None)
    """
    return round(float(value), digits) + 0.0 if math.isfinite(value) else None
