"""What catheters, wires and leads are made of."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ....geometry import CameraModel, arc_length
from ....types import FloatArray, IntArray
from ._materials import ATTENUATION_PER_M as PER_M
from ._materials import loaded_polymer_per_m
from ._profile import POINTS_PER_M, Course, Layer, Profiles, course, profiles
from ._scene import CatheterMake, Device, Rhythm
from ._tube import Picture, add_tube

__all__ = ["Sections", "Tube", "catheter_tube", "device_course", "device_tube", "sheath_tube", "swayed"]

Sections = list[tuple[float, float, int, float]]
"""From, to (m along the tube), number of the material, strength."""

_BLOOD = Layer(0.0, 1.0, -PER_M["soft_tissue"])
"""A tube takes the place of what would be there without it."""


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """A tube as one view sees it."""

    radius_m: float
    profiles: Profiles
    course: Course

    def add(self, drawn: Picture, spans: IntArray, camera: CameraModel, points_m: FloatArray) -> None:
        """Add its attenuation along ``points_m`` (n, 3), in the camera's world, to ``drawn`` (h, w)."""
        p = self.profiles
        add_tube(
            drawn, spans, camera.row, points_m, self.radius_m,
            p.table, p.half_px, p.reach_px, self.course.amount, self.course.size,
        )  # fmt: skip


def _sleeve(thickness_m: float, radius_m: float) -> Layer:
    return Layer(max(0.0, 1.0 - thickness_m / radius_m), 1.0, PER_M["platinum"])


def _dome(way: Course, length_m: float, radius_m: float) -> Course:
    """The same with a hemisphere at its end."""
    left = np.clip(length_m - np.arange(way.size.size) / POINTS_PER_M, 0.0, radius_m)
    return Course(way.amount, np.sqrt(np.maximum(1.0 - (1.0 - left / radius_m) ** 2, 0.0)))


def catheter_tube(make: CatheterMake, length_m: float, seed: int, px_per_m: float, blur_px: float) -> Tube:
    """Shaft of loaded polymer with a steel braid and copper wires inside, platinum rings and tip with a dome."""
    inner = 1.0 - make.wall
    polymer, braid = loaded_polymer_per_m(make.barium_sulphate), 0.5 * (1.0 + inner)
    shaft = (
        _BLOOD,
        Layer(inner, 1.0, polymer),
        Layer(braid - 0.03, braid + 0.03, make.braid * PER_M["steel"] - polymer),
        Layer(0.0, inner, make.core * PER_M["copper"]),
    )
    ring, tip = (*shaft, _sleeve(0.10e-3, make.radius_m)), (*shaft, _sleeve(0.28e-3, make.radius_m))
    sections: Sections = []
    at = 0.0
    for start, end in sorted((length_m - b, length_m - a) for a, b in make.rings_m):
        sections += [(at, start, 0, 1.0), (start, end, 1, 1.0)]
        at = end
    sections += [(at, length_m - make.electrode_m, 0, 1.0), (length_m - make.electrode_m, length_m, 2, 1.0)]
    made = course(length_m, sections, 3)
    rng = np.random.default_rng([seed, 11])
    knots = np.linspace(0.0, length_m, max(4, int(length_m / 4e-3)))
    uneven = CubicSpline(knots, rng.normal(0, 0.5, knots.size))(np.arange(made.size.size) / POINTS_PER_M)
    made.amount[0] = np.cumsum(np.diff(made.amount[0], prepend=0.0) * np.maximum(1.0 + make.uneven * uneven, 0.1))
    table = profiles([shaft, ring, tip], make.radius_m, px_per_m, blur_px)
    return Tube(make.radius_m, table, _dome(made, length_m, make.radius_m))


def sheath_tube(make: CatheterMake, length_m: float, px_per_m: float, blur_px: float) -> Tube:
    """The sheath around the shaft, from its mouth, where it has a marker band, backwards; the shaft inside goes on."""
    radius = make.radius_m + 0.85e-3
    inner = (make.radius_m + 0.2e-3) / radius
    polymer = loaded_polymer_per_m(0.2)
    shaft = (1.0 - make.wall) * make.radius_m / radius
    wall = (
        _BLOOD,
        Layer(inner, 1.0, polymer),
        Layer(0.5 + 0.5 * inner, 0.55 + 0.45 * inner, 0.5 * PER_M["steel"]),
        Layer(shaft, make.radius_m / radius, loaded_polymer_per_m(make.barium_sulphate)),
        Layer(0.0, shaft, make.core * PER_M["copper"]),
    )
    band = (*wall, _sleeve(0.08e-3, radius))
    sections: Sections = [(0.0, 1.5e-3, 0, 1.0), (1.5e-3, 3.0e-3, 1, 1.0), (3.0e-3, length_m, 0, 1.0)]
    return Tube(radius, profiles([wall, band], radius, px_per_m, blur_px), course(length_m, sections, 2))


def device_tube(device: Device, length_m: float, px_per_m: float, blur_px: float) -> Tube:
    """A wire, a diagnostic catheter, a defibrillator's lead or an ultrasound probe."""
    r = device.radius_m
    materials: list[tuple[Layer, ...]]
    sections: Sections
    if device.kind == "wire":
        materials = [(_BLOOD, Layer(0.0, 0.68, PER_M["nitinol"]), Layer(0.68, 1.0, 0.6 * PER_M["steel"]))]
        sections = [(0.0, length_m, 0, 1.0)]
    elif device.kind == "diagnostic":
        shaft = (_BLOOD, Layer(0.6, 1.0, loaded_polymer_per_m(0.22)), Layer(0.0, 0.6, 0.05 * PER_M["copper"]))
        materials = [shaft, (*shaft, _sleeve(0.1e-3, r))]
        sections, end = [], length_m
        for k in range(10 if r > 0.85e-3 else 4):
            long = 2e-3 if k == 0 else 1e-3
            sections += [(end - long, end, 1, 1.0), (end - long - (2e-3 + 3e-3 * (k % 2)), end - long, 0, 1.0)]
            end = sections[-1][0]
        sections.append((0.0, end, 0, 1.0))
    elif device.kind == "lead":
        body = (_BLOOD, Layer(0.0, 0.5, 0.35 * PER_M["steel"]), Layer(0.5, 1.0, PER_M["polymer"]))
        materials = [body, (*body, Layer(0.85, 1.0, 0.5 * PER_M["platinum"]))]
        coil = length_m - 62e-3
        sections = [(0.0, coil, 0, 1.0), (coil, coil + 48e-3, 1, 1.0), (coil + 48e-3, length_m - 2e-3, 0, 1.0)]
        sections.append((length_m - 2e-3, length_m, 1, 1.0))
    else:
        body = (_BLOOD, Layer(0.8, 1.0, PER_M["polymer"]), Layer(0.55, 0.75, 0.12 * PER_M["steel"]))
        materials = [body, (*body, Layer(0.0, 0.8, 0.10 * PER_M["steel"]))]
        sections = [(0.0, length_m, 0, 1.0), (length_m - 32e-3, length_m - 4e-3, 1, 1.0)]
        sections += [(x, x + 2e-3, 1, 0.5) for x in np.arange(length_m - 80e-3, length_m - 36e-3, 6e-3)]
    made = course(length_m, sections, len(materials))
    return Tube(r, profiles(materials, r, px_per_m, blur_px), _dome(made, length_m, r))


def device_course(device: Device) -> tuple[FloatArray, FloatArray, float]:
    """(n, 3) points along it at rest, patient's frame, uniform in arc length; (n,) how much each sways; length."""
    knots = np.array(device.knots)
    at = arc_length(knots)
    spline = CubicSpline(at, knots)
    fine = spline(np.linspace(0.0, at[-1], 2000))
    arc = arc_length(fine)
    count = math.ceil(arc[-1] / 1.5e-3) + 1
    even = np.linspace(0.0, arc[-1], count)
    points = np.stack([np.interp(even, arc, fine[:, k]) for k in range(3)], axis=1)
    return points, (even / arc[-1]) ** 2, float(arc[-1])


def swayed(device: Device, points_m: FloatArray, share: FloatArray, rhythm: Rhythm, time_s: float) -> FloatArray:
    """(n, 3): where the heart and the breath have moved it."""
    beat = rhythm.beating(time_s + device.phase / rhythm.heart_hz) - 0.5
    breath = np.array([0.0, 0.0, -0.35 * rhythm.breath_m * rhythm.breath(time_s)])
    return points_m + share[:, None] * (beat * np.array(device.sway_m) + breath)
