"""Layered tubes: attenuation of their materials, absorption of a section, and their change along the tube.

80 kVp behind 3 mm of aluminium and a chest is attenuated like a single energy near 50 keV. Values: mass attenuation
coefficients at 50 keV (NIST XCOM / Hubbell and Seltzer 1995; mixtures by weight) times the usual densities. One energy
for all: beam hardening is left out.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, IntArray
from ._tube_kernels import POINTS_PER_M, STEPS_PER_PX, FloatImage, add_tube

_OPAQUE = 12.0
"""Largest attenuation: exp(-12) of the light passes, and its logarithm stays finite."""


@dataclass(frozen=True, slots=True)
class Layer:
    """A shell of a tube.

    Attributes:
        inner: inner radius as a share of the tube's.
        outer: outer radius as a share of the tube's.
        per_m: linear attenuation, 1/m.
    """

    inner: float
    outer: float
    per_m: float


@dataclass(frozen=True, slots=True, eq=False)
class SectionProfile:
    """Attenuation of tubes of some materials across their width.

    Attributes:
        table: (materials, across) attenuation, by the distance from the middle in steps of 1 / `STEPS_PER_PX` px.
        half_px: radius of the tube for which the table is made.
        reach_px: largest distance in the table.
    """

    table: npt.NDArray[np.float32]
    half_px: float
    reach_px: float


@dataclass(frozen=True, slots=True, eq=False)
class AxialProfile:
    """A tube along its arc length, in points `POINTS_PER_M` apart from its start.

    Attributes:
        amount: (materials, n) length in metres of each material from the start to here, weighted by its strength.
        size: (n,) radius here as a share of the tube's.
    """

    amount: FloatArray
    size: FloatArray


def chord_attenuation(layers: tuple[Layer, ...], radius_m: float, across_m: FloatArray) -> FloatArray:
    """Returns the attenuation by a straight tube of rays at right angles to it: -ln of the share that passes.

    Args:
        layers: materials of the tube.
        radius_m: radius of the tube.
        across_m: (n,) distances of the rays from its axis.

    Returns:
        (n,) attenuation.
    """
    total = np.zeros_like(across_m)
    for layer in layers:
        outer, inner = (np.sqrt(np.maximum((x * radius_m) ** 2 - across_m**2, 0.0)) for x in (layer.outer, layer.inner))
        total += 2.0 * layer.per_m * (outer - inner)
    return total


def section_profiles(
    materials: list[tuple[Layer, ...]], radius_m: float, px_per_m: float, blur_px: float
) -> SectionProfile:
    """Makes the tables of attenuation across tubes, seen through a Gaussian aperture.

    The aperture averages the light, not its logarithm: the edges of opaque metal are where they are visible.

    Args:
        materials: layers of each kind of section.
        radius_m: radius of the tubes.
        px_per_m: scale of the image.
        blur_px: standard deviation of the aperture.

    Returns:
        The tables.
    """
    half_px = radius_m * px_per_m
    reach_px = math.ceil(half_px + 4.0 * blur_px) + 1.0
    fine = 8 * STEPS_PER_PX  # the convolution is done in steps eight times finer than the table's
    across_px = (np.arange(-int(1.5 * reach_px * fine), int(1.5 * reach_px * fine) + 1)) / fine
    kernel_px = np.arange(-math.ceil(5 * blur_px * fine), math.ceil(5 * blur_px * fine) + 1) / fine
    kernel = np.exp(-0.5 * (kernel_px / blur_px) ** 2)
    kernel /= kernel.sum()
    middle = across_px.size // 2
    table_steps = middle + np.arange(int(reach_px) * STEPS_PER_PX + 2) * 8
    table = np.empty((len(materials), table_steps.size), np.float32)
    for k, layers in enumerate(materials):
        transmitted = np.exp(-np.minimum(chord_attenuation(layers, radius_m, across_px / px_per_m), _OPAQUE))
        table[k] = -np.log(np.convolve(transmitted, kernel, mode="same"))[table_steps]
    table[:, -2:] = 0.0  # beyond the reach, where the kernels read one step too far
    return SectionProfile(table, half_px, reach_px)


def axial_profile(length_m: float, sections: list[tuple[float, float, int, float]], materials: int) -> AxialProfile:
    """Makes the profile of a tube of constant radius along its axis.

    Args:
        length_m: length of the tube.
        sections: from, to (m along the tube), number of the material, strength.
        materials: number of materials.

    Returns:
        The profile.
    """
    n = math.ceil(length_m * POINTS_PER_M) + 2
    at = np.arange(n) / POINTS_PER_M
    amount = np.zeros((materials, n))
    for start, end, material, strength in sections:
        amount[material] += strength * np.clip(at - start, 0.0, end - start)
    return AxialProfile(amount, np.ones(n))


_BARIUM_SULPHATE = (8.252, 4.50)
_POLYETHER_BLOCK_AMIDE = (0.2067, 1.01)
"""Mass attenuation in cm^2/g, density in g/cm^3."""
ATTENUATION_PER_M: dict[str, float] = {
    "platinum": 100 * 6.954 * 21.45,
    "copper": 100 * 2.613 * 8.96,
    "steel": 100 * 1.957 * 7.90,
    "nitinol": 100 * (0.55 * 2.475 + 0.45 * 1.213) * 6.45,
    "tungsten": 100 * 5.951 * 19.30,
    "cortical_bone": 100 * 0.4242 * 1.92,
    "spongy_bone": 100 * 0.2950 * 1.18,
    "soft_tissue": 100 * 0.2264 * 1.06,
    "lung": 100 * 0.2270 * 0.26,
    "polymer": 100 * _POLYETHER_BLOCK_AMIDE[0] * _POLYETHER_BLOCK_AMIDE[1],
}
"""Linear attenuation at 50 keV, 1/m."""


def loaded_polymer_per_m(barium_sulphate: float) -> float:
    """Returns the linear attenuation, 1/m, of a catheter's polymer with this share by weight of barium sulphate.

    >>> round(loaded_polymer_per_m(0.0), 1), round(loaded_polymer_per_m(0.3), 1)
    (20.9, 344.9)
    """
    share, rest = barium_sulphate, 1.0 - barium_sulphate
    density = 1.0 / (share / _BARIUM_SULPHATE[1] + rest / _POLYETHER_BLOCK_AMIDE[1])
    return 100 * density * (share * _BARIUM_SULPHATE[0] + rest * _POLYETHER_BLOCK_AMIDE[0])


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """A tube as one view sees it."""

    radius_m: float
    section_profiles: SectionProfile
    axial_profile: AxialProfile

    def add(self, drawn: FloatImage, spans: IntArray, camera: CameraModel, points_m: FloatArray) -> None:
        """Adds the tube's attenuation to an image.

        Args:
            drawn: (h, w) attenuation that is changed.
            spans: (h, 2) first column and end of the touched pixels in each row; they are widened.
            camera: camera of the view.
            points_m: (n, 3) axis, in the camera's world, uniform in arc length.
        """
        p = self.section_profiles
        add_tube(
            drawn, spans, camera.row, points_m, self.radius_m,
            p.table, p.half_px, p.reach_px, self.axial_profile.amount, self.axial_profile.size,
        )  # fmt: skip
