"""What a layered tube takes from the rays across its width, and how its make changes along it."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ....types import FloatArray

__all__ = ["POINTS_PER_M", "STEPS_PER_PX", "Course", "Layer", "Profiles", "chord_attenuation", "course", "profiles"]

STEPS_PER_PX = 16
POINTS_PER_M = 50_000.0
"""Steps of what varies along a tube: 20 um; between them it is linear."""
_OPAQUE = 12.0


@dataclass(frozen=True, slots=True)
class Layer:
    """A shell of a tube from ``inner`` to ``outer`` (shares of its radius) that weakens by ``per_m``."""

    inner: float
    outer: float
    per_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """What tubes of some materials take from the light across their width.

    ``table`` (materials, across) float32: attenuation of a tube that lies across the rays, by the distance from its
    middle in steps of 1 / `STEPS_PER_PX` px, 0 to ``reach_px``, where the tube's radius is ``half_px``.
    """

    table: npt.NDArray[np.float32]
    half_px: float
    reach_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """How a tube goes on along its arc length, in points `POINTS_PER_M` apart from its start.

    ``amount`` (materials, n): length in metres of each material from the start to here, weighed by its strength;
    ``size`` (n,): radius here as a share of the tube's.
    """

    amount: FloatArray
    size: FloatArray


def chord_attenuation(layers: tuple[Layer, ...], radius_m: float, across_m: FloatArray) -> FloatArray:
    """-ln of what is left of rays that pass a straight tube at right angles, ``across_m`` beside its axis."""
    total = np.zeros_like(across_m)
    for layer in layers:
        outer, inner = (np.sqrt(np.maximum((x * radius_m) ** 2 - across_m**2, 0.0)) for x in (layer.outer, layer.inner))
        total += 2.0 * layer.per_m * (outer - inner)
    return total


def profiles(materials: list[tuple[Layer, ...]], radius_m: float, px_per_m: float, blur_px: float) -> Profiles:
    """Tables of tubes of these ``materials``, seen through an aperture of ``blur_px`` (sigma).

    What the aperture averages is the light, not its logarithm: the edges of opaque metal lie where they are seen.
    """
    half = radius_m * px_per_m
    reach = math.ceil(half + 4.0 * blur_px) + 1.0
    fine = 8 * STEPS_PER_PX
    at = (np.arange(-int(1.5 * reach * fine), int(1.5 * reach * fine) + 1)) / fine
    tail = np.arange(-math.ceil(5 * blur_px * fine), math.ceil(5 * blur_px * fine) + 1) / fine
    kernel = np.exp(-0.5 * (tail / blur_px) ** 2)
    kernel /= kernel.sum()
    middle = at.size // 2
    picked = middle + np.arange(int(reach) * STEPS_PER_PX + 2) * 8
    table = np.empty((len(materials), picked.size), np.float32)
    for k, layers in enumerate(materials):
        left = np.exp(-np.minimum(chord_attenuation(layers, radius_m, at / px_per_m), _OPAQUE))
        table[k] = -np.log(np.convolve(left, kernel, mode="same"))[picked]
    table[:, -2:] = 0.0
    return Profiles(table, half, reach)


def course(length_m: float, sections: list[tuple[float, float, int, float]], materials: int) -> Course:
    """From ``sections`` (from, to, material, strength) of a tube of ``length_m``; constant size."""
    n = math.ceil(length_m * POINTS_PER_M) + 2
    at = np.arange(n) / POINTS_PER_M
    amount = np.zeros((materials, n))
    for start, end, material, strength in sections:
        amount[material] += strength * np.clip(at - start, 0.0, end - start)
    return Course(amount, np.ones(n))
