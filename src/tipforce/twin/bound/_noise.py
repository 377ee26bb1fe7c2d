"""What was measured on the presets: the error of seen centrelines, and what forces there are."""

from dataclasses import dataclass

import numpy as np

from ...mechanics import LineNoise
from ...types import FloatArray

__all__ = ["FORCES_N2", "MEASURED", "SeenNoise"]


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
            0.0283, 12.5, 0.414, base_std_m=0.0286, base_m=2.28, tip_std_m=0.151, tip_m=16.3,
            white_share=0.001, common_share=0.123,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0176, 67.9, 0.555, base_std_m=0.0187, base_m=13.1, tip_std_m=0.135, tip_m=16.3,
            white_share=0.110, common_share=0.0001,
        ).scaled(_PX_M),
    ),
    "generalise": SeenNoise(
        fresh=LineNoise(
            0.0062, 10.0, 0.512, base_std_m=0.0775, base_m=151.0, tip_std_m=0.232, tip_m=23.9,
            white_share=0.001, common_share=0.0001,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0454, 256.0, 0.314, base_std_m=0.0074, base_m=153.0, tip_std_m=0.324, tip_m=5.06,
            white_share=0.210, common_share=0.267,
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
beforehand who have learnt from other sessions what forces there are. ``python -m bench.bound`` measures it."""
