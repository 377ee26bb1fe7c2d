"""How the page writes numbers; a missing one is a dash."""

import json
import math
from collections.abc import Callable
from typing import Any

from ..units import newtons_to_grams

__all__ = ["FILTERS"]


def _number(value: float | None, digits: int, small_digits: int | None = None, small: float = 1.0) -> str:
    """``value`` with ``digits`` decimals, ``small_digits`` below ``small``; U+2212 as minus."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits if small_digits is None or abs(value) >= small else small_digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _mn(newtons: float | None) -> str:
    return _number(_times(newtons, 1e3), 0, 1, 10.0)


def _grams(grams: float | None) -> str:
    return _number(grams, 1, 2)


def _newtons_as_grams(newtons: float | None) -> str:
    return _grams(None if newtons is None else newtons_to_grams(newtons))


def _newtons(newtons: float | None) -> str:
    return _number(newtons, 3, 4, 0.01)


def _percent(percent: float | None) -> str:
    return _number(percent, 1)


def _share(share: float | None) -> str:
    return _number(_times(share, 100.0), 1)


def _pretty(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False)


def _facts(value: Any) -> str:
    """Nested facts on one line, numbers short."""
    if isinstance(value, dict):
        return ", ".join(f"{str(key).replace('_', ' ')} {_facts(item)}" for key, item in value.items())
    if isinstance(value, list):
        return " ".join(_facts(item) for item in value)
    return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)


FILTERS: dict[str, Callable[..., str]] = {
    "mn": _mn,
    "grams": _grams,
    "n_to_g": _newtons_as_grams,
    "newtons": _newtons,
    "percent": _percent,
    "share": _share,
    "fixed": _number,
    "pretty": _pretty,
    "facts": _facts,
}
"""Filters of the template: what a value is -> its text."""
