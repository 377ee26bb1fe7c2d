"""What was measured on the presets: the error of seen centrelines, and what forces there are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mechanics import LineNoise
from ..simulation._ranges import Settings
from ..simulation._settings import PRESETS
from ..types import FloatArray

__all__ = ["FORCES_N2", "MEASURED", "SeenNoise", "measured_on"]


@dataclass(frozen=True, slots=True)
class SeenNoise:
    """Errors of a seen line in the plane of the catheter: ``fresh`` in every frame, and those ``lasting`` a session."""

    fresh: LineNoise
    lasting: LineNoise


_PX_M = 0.2e-3
"""A pixel in the presets' middle."""

MEASURED: dict[str, SeenNoise] = {
    "bench-2021": SeenNoise(
        fresh=LineNoise(
            0.0257, 13.7, 0.287, base_std_m=0.0299, base_m=2.28, tip_std_m=0.176, tip_m=18.8,
            white_share=0.001, common_share=0.0514,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0264, 70.1, 1.022, base_std_m=0.0178, base_m=2.28, tip_std_m=0.249, tip_m=14.1,
            white_share=0.143, common_share=0.0001,
        ).scaled(_PX_M),
    ),
    "generalise": SeenNoise(
        fresh=LineNoise(
            0.0130, 23.3, 0.561, base_std_m=0.0561, base_m=2.88, tip_std_m=0.415, tip_m=66.8,
            white_share=0.0465, common_share=0.0001,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0315, 33.2, 1.183, base_std_m=0.0409, base_m=6.13, tip_std_m=0.266, tip_m=59.6,
            white_share=0.0724, common_share=0.131,
        ).scaled(_PX_M),
    ),
}  # fmt: skip
"""By preset, of what `fine` sees, given in pixels: what ``python -m bench.line_noise`` found."""


def _covariance(std_n: list[float], xy: float, xz: float, yz: float) -> FloatArray:
    return np.outer(std_n, std_n) * np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


FORCES_N2: dict[str, FloatArray] = {
    "bench-2021": _covariance([0.0727, 0.0560, 0.0056], 0.307, 0.004, -0.207),
    "generalise": _covariance([0.0702, 0.0585, 0.0049], 0.071, -0.067, -0.207),
}
"""(3, 3) by preset: covariance of the force in contact, base frame, over sessions 40 to 79 of seed 0: what those know
beforehand who have learnt from other sessions what forces there are. ``python -m bench.limits`` measures it."""


def measured_on(settings: Settings | Mapping[str, Any]) -> str | None:
    """The preset on whose pictures `MEASURED` stands for those of ``settings``; None where that was not measured.

    ``settings`` as they are or as a truth states them. Sessions of another length look the same.

    >>> measured_on(PRESETS["generalise"])
    'generalise'
    """
    stated = settings.model_dump(mode="json") if isinstance(settings, Settings) else settings
    if stated.get("preset") in MEASURED:
        return str(stated["preset"])
    return next((name for name in MEASURED if _look(stated) == _look(PRESETS[name].model_dump(mode="json"))), None)


def _look(stated: Mapping[str, Any]) -> dict[str, Any]:
    """What a session's pictures and forces are drawn from."""
    look = {name: value for name, value in stated.items() if name not in ("preset", "seed", "number")}
    return look | {"world": {name: value for name, value in look.get("world", {}).items() if name != "seconds"}}
