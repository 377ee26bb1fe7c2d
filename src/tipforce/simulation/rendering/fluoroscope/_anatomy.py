"""Bones, wires and leads of a chest as tubes in space, and its soft parts as ellipsoids; the patient's frame, metres.

The shapes copy no person: they are rough, of the usual sizes, and give the image the edges and gradients of cardiac
fluoroscopy.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from ....geometry import arc_length
from ....types import FloatArray
from ._scene import Anatomy
from ._tube_model import ATTENUATION_PER_M as PER_M
from ._tube_model import Layer

_SOFT = PER_M["soft_tissue"]
_SPONGY, _CORTICAL = PER_M["spongy_bone"] - _SOFT, PER_M["cortical_bone"] - _SOFT


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A tube of the anatomy.

    Attributes:
        points_m: (n, 3) axis.
        radius_m: radius.
        materials: layers of each kind of section.
        sections: from, to (m along the axis), number of the material, strength.
        waists: from, to, and relative reduction of the radius in the middle of that stretch.
    """

    points_m: FloatArray
    radius_m: float
    materials: list[tuple[Layer, ...]]
    sections: list[tuple[float, float, int, float]]
    waists: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])

    @property
    def length_m(self) -> float:
        """Arc length."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True)
class Blob:
    """An ellipsoid.

    Attributes:
        middle_m: (3,) centre.
        half_m: (3,) half axes along the patient's axes.
        per_m: linear attenuation minus that of its surroundings, 1/m.
    """

    middle_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    per_m: float


def _bone(knots_mm: FloatArray, radius_mm: float, shell_mm: float, density: float, fade: bool = False) -> Part:
    """Makes a bone along a smooth curve through knots: a spongy core in a cortical shell; lengths in mm.

    ``knots_mm`` (n, 3) are in the patient's frame; ``density`` is relative; with ``fade`` the bone gets weaker towards
    its end.
    """
    knot_arc_mm = arc_length(knots_mm)
    count = max(6, int(knot_arc_mm[-1] / 3.0))
    points = 1e-3 * CubicSpline(knot_arc_mm, knots_mm)(np.linspace(0.0, knot_arc_mm[-1], count))
    inner_share = max(0.0, 1.0 - shell_mm / radius_mm)
    layers = (Layer(0.0, inner_share, density * _SPONGY), Layer(inner_share, 1.0, density * _CORTICAL))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    steps = np.linspace(0.0, length, 65 if fade else 2)
    strengths = np.linspace(1.0, 0.0, 64) ** 0.7 if fade else np.ones(1)
    pieces = zip(steps[:-1].tolist(), steps[1:].tolist(), strengths.tolist(), strict=True)
    sections: list[tuple[float, float, int, float]] = [(start, end, 0, strength) for start, end, strength in pieces]
    return Part(points, 1e-3 * radius_mm, [layers], sections)


def _off(point: FloatArray, x: float, y: float, z: float) -> FloatArray:
    return point + np.array([x, y, z])


def spine_parts(anatomy: Anatomy, rng: np.random.Generator) -> list[Part]:
    """Makes the vertebrae, with end plates, pedicles, spinous and transverse processes.

    Args:
        anatomy: position and density of the spine.
        rng: random numbers of the patient.

    Returns:
        The parts in the patient's frame, in metres.
    """
    x0_mm, y0_mm = (1e3 * a for a in anatomy.spine_m)
    pitch_mm, disc_mm = rng.uniform(25, 30), rng.uniform(3.5, 6.0)
    offset = rng.uniform(0, pitch_mm)
    z = np.linspace(-150, 150, 60)
    sway = rng.normal(0, 3.0) * np.sin(z / 70 + rng.uniform(0, 6))
    axis = np.stack([x0_mm + sway, y0_mm + 4e-4 * (z - 20) ** 2 * 0.3, z], axis=1)
    radius_mm = rng.uniform(14.5, 17.5)
    density = anatomy.bone
    spongy = (Layer(0.0, 0.96, density * _SPONGY), Layer(0.96, 1.0, density * _CORTICAL))
    plate = (Layer(0.0, 0.93, 0.35 * density * _CORTICAL),)
    whole = Part(1e-3 * axis, 1e-3 * radius_mm, [spongy, plate], [])
    total_m = whole.length_m
    parts = [whole]
    for k in range(int(1e3 * total_m / pitch_mm) + 1):
        # One vertebra: ends along the axis in m; it is narrower in the middle, and denser at its two end plates.
        low, high = 1e-3 * (offset + (k - 1) * pitch_mm + disc_mm), 1e-3 * (offset + k * pitch_mm)
        low, high = max(0.0, low), min(total_m, high)
        if high - low < 4e-3:
            continue
        whole.waists.append((low, high, float(rng.uniform(0.10, 0.17))))
        steps, strengths = np.linspace(low, high, 9), rng.uniform(0.8, 1.2, 8)
        whole.sections.extend(
            (float(a), float(b), 0, float(c)) for a, b, c in zip(steps, steps[1:], strengths, strict=False)
        )
        whole.sections.extend([(low, low + 1.5e-3, 1, 1.0), (high - 1.5e-3, high, 1, 1.0)])
        middle = np.array([np.interp(0.5 * (low + high), np.linspace(0, total_m, 60), axis[:, a]) for a in range(3)])
        for side in (-1.0, 1.0):  # a pedicle and a transverse process
            root = _off(middle, side * 0.68 * radius_mm, 0.8 * radius_mm, 0.28 * pitch_mm)
            parts.append(
                _bone(np.array([root, _off(root, side * 1, 7, 0), _off(root, side * 2, 15, -1)]), 4.2, 1.1, density)
            )
            base = _off(root, side * 2, 13, -2)
            transverse = [base, _off(base, side * 14, 7, 2), _off(base, side * 27, 13, 5)]
            parts.append(_bone(np.array(transverse), 4.0, 0.7, 0.8 * density))
        # The spinous process points back and down.
        back = _off(middle, 0, radius_mm + 16, 0)
        spinous = np.array([back, _off(back, rng.normal(0, 1), 14, -9), _off(back, rng.normal(0, 1.5), 24, -22)])
        parts.append(_bone(spinous, 3.6, 1.0, density))
    return parts


def chest_parts(anatomy: Anatomy, rng: np.random.Generator) -> tuple[list[Part], list[Part]]:
    """Makes the parts that move a little with the breath: ribs and vessels; sternal wires and leads on the skin.

    Args:
        anatomy: the patient.
        rng: random numbers of the patient.

    Returns:
        Tissue and metal in the patient's frame, in metres.
    """
    tissue = [*_ribs(anatomy, rng), *_vessels(anatomy, rng)]
    return tissue, [*_sternal(anatomy, rng), *_leads(anatomy, rng)]


def _ribs(anatomy: Anatomy, rng: np.random.Generator) -> list[Part]:
    """Makes 12 pairs of ribs: from the spine around the side to the front, falling, and fading to cartilage."""
    parts: list[Part] = []
    x0_mm, y0_mm = (1e3 * a for a in anatomy.spine_m)
    pitch_mm, first_mm = rng.uniform(25, 30), rng.uniform(-15, 15)
    width_mm, depth_mm, drop_mm = rng.uniform(112, 132), rng.uniform(82, 98), rng.uniform(75, 120)
    around_rad = np.linspace(0.005, 2.75, 24)
    for k in range(-4, 8):
        for side in (-1.0, 1.0):
            x = x0_mm + side * (12 + (width_mm - 0.5 * side * x0_mm) * np.sin(around_rad) ** 0.8)
            y = y0_mm + 14 - depth_mm * (1 - np.cos(around_rad))
            z = first_mm + k * pitch_mm + 22 - drop_mm * (around_rad / around_rad[-1]) ** 1.25 + rng.normal(0, 1.0)
            parts.append(_bone(np.stack([x, y, z], axis=1), rng.uniform(4.6, 6.0), 0.9, 0.75 * anatomy.bone, fade=True))
    return parts


def _vessels(anatomy: Anatomy, rng: np.random.Generator) -> list[Part]:
    """Makes the lung's vessels: they branch outward from both hila and get thinner."""
    parts: list[Part] = []
    contrast = anatomy.lung * (PER_M["soft_tissue"] - PER_M["lung"])
    for side in (-1.0, 1.0):
        for _ in range(34):
            start = np.array([side * rng.uniform(25, 40), rng.normal(5, 8), rng.normal(12, 12)])
            direction = np.array([side * rng.uniform(0.2, 1.0), rng.normal(0, 0.6), rng.normal(0, 0.8)])
            direction /= np.linalg.norm(direction)
            points, radius = [start], rng.uniform(0.8, 2.8)
            for _ in range(6):
                direction = direction + rng.normal(0, 0.16, 3)
                direction /= np.linalg.norm(direction)
                points.append(points[-1] + 11 * direction)
            part = _bone(np.array(points), radius, radius, 1.0, fade=True)
            parts.append(Part(part.points_m, part.radius_m, [(Layer(0.0, 1.0, contrast),)], part.sections))
    return parts


def solid_tube(points_mm: FloatArray, radius_mm: float, per_m: float) -> Part:
    """Makes a solid tube of one material.

    Args:
        points_mm: (n, 3) points of the axis in mm.
        radius_mm: radius in mm.
        per_m: linear attenuation minus that of its surroundings, 1/m.

    Returns:
        The tube.
    """
    curve = _bone(points_mm, radius_mm, radius_mm, 1.0)
    return Part(curve.points_m, curve.radius_m, [(Layer(0.0, 1.0, per_m),)], [(0.0, curve.length_m, 0, 1.0)])


def _sternal(anatomy: Anatomy, rng: np.random.Generator) -> list[Part]:
    """Makes the steel loops that closed the breastbone, each with its twist."""
    parts: list[Part] = []
    x0_mm = 1e3 * anatomy.spine_m[0] + rng.normal(0, 4)
    for k in range(anatomy.sternal_wires):
        turn = np.linspace(0.0, 2 * math.pi, 22)
        width_mm, height_mm = rng.uniform(7, 11), rng.uniform(4, 9)
        middle = np.array([x0_mm + rng.normal(0, 2), -78.0 + 0.1 * k, -45 + 21 * k + rng.normal(0, 3)])
        x, z = width_mm * np.sin(turn), height_mm * np.cos(turn) + 2 * np.sin(turn)
        loop = middle + np.stack([x, 6 * np.cos(turn), z], axis=1)
        twist = np.linspace(0.0, 1.0, 12)[:, None] * (rng.normal(0, 3), -1.0, rng.uniform(-11, -6)) + loop[11]
        parts += [solid_tube(loop, 0.4, PER_M["steel"]), solid_tube(twist, 0.65, PER_M["steel"])]
    return parts


def _leads(anatomy: Anatomy, rng: np.random.Generator) -> list[Part]:
    """Makes electrocardiogram leads on the skin, some with their clip in view."""
    parts: list[Part] = []
    for _ in range(anatomy.leads):
        skin_y = rng.choice([-105.0, 105.0])
        start, direction_rad = rng.uniform(-70, 70, 2), rng.uniform(0.0, 2 * math.pi)
        end = 130 * np.array([math.cos(direction_rad), math.sin(direction_rad)])  # out of the image
        middle = 0.6 * start + 0.4 * end + rng.normal(0, 18, 2)
        knots = np.array([(*start, skin_y), (*middle, skin_y), (*end, skin_y)])
        parts.append(solid_tube(knots[:, [0, 2, 1]], rng.uniform(0.35, 0.6), 0.35 * PER_M["copper"]))
        clip = knots[0, [0, 2, 1]]
        parts.append(
            solid_tube(np.array([clip, _off(clip, 0, 1.0, 0), _off(clip, 0, 2.0, 0)]), rng.uniform(3, 5), 130.0)
        )
    return parts


def heart_blobs(anatomy: Anatomy) -> list[Blob]:
    """Ventricles, atria, great vessels: soft tissue where the lung would be."""
    contrast = anatomy.lung * (PER_M["soft_tissue"] - PER_M["lung"])
    size = anatomy.heart_size
    shapes = [
        ((22, -18, -18), (44, 40, 36)), ((-6, -24, -14), (46, 34, 40)), ((-26, 2, 4), (28, 32, 36)),
        ((10, 22, 8), (36, 28, 30)), ((2, 0, 52), (22, 26, 34)), ((16, -4, 46), (18, 20, 26)),
        ((-24, 6, 60), (12, 12, 50)), ((-8, 44, 0), (26, 24, 160)),
    ]  # fmt: skip
    return [
        Blob(
            (1e-3 * m[0], 1e-3 * m[1], 1e-3 * m[2]),
            (1e-3 * size * h[0], 1e-3 * size * h[1], 1e-3 * size * h[2]),
            contrast,
        )
        for m, h in shapes
    ]


def liver_blobs(anatomy: Anatomy) -> list[Blob]:
    """Makes the organs below the two domes of the diaphragm, breathed out."""
    contrast = anatomy.lung * (PER_M["soft_tissue"] - PER_M["lung"])
    right, left = anatomy.dome_m + 8e-3, anatomy.dome_m - 6e-3
    return [
        Blob((-55e-3, -5e-3, right - 85e-3), (95e-3, 95e-3, 85e-3), contrast),
        Blob((62e-3, -5e-3, left - 80e-3), (82e-3, 90e-3, 80e-3), contrast),
    ]
