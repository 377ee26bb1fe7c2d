"""Materials of catheters, wires and leads; layers, lengths and distances are those of usual devices."""

import math

import numpy as np
from scipy.interpolate import CubicSpline

from ....geometry import arc_length
from ....types import FloatArray
from ._scene import CatheterConstruction, Instrument, Rhythm
from ._tube_kernels import POINTS_PER_M
from ._tube_model import ATTENUATION_PER_M as PER_M
from ._tube_model import AxialProfile, Layer, Tube, axial_profile, loaded_polymer_per_m, section_profiles

Sections = list[tuple[float, float, int, float]]
"""From, to (m along the tube), number of the material, strength."""
_BLOOD = Layer(0.0, 1.0, -PER_M["soft_tissue"])
"""A tube replaces the blood at its position."""


def _sleeve(thickness_m: float, radius_m: float) -> Layer:
    return Layer(max(0.0, 1.0 - thickness_m / radius_m), 1.0, PER_M["platinum"])


def _banded(length_m: float, bands_m: tuple[tuple[float, float], ...]) -> tuple[Sections, float]:
    """Returns the sections of a shaft (material 0) with metal bands (material 1), and the end of the last one.

    Args:
        length_m: length of the tube.
        bands_m: start and end of each band, measured back from the apex.
    """
    sections: Sections = []
    at = 0.0
    for start, end in sorted((length_m - b, length_m - a) for a, b in bands_m):
        sections += [(at, start, 0, 1.0), (start, end, 1, 1.0)]
        at = end
    return sections, at


def _dome(profile: AxialProfile, length_m: float, radius_m: float) -> AxialProfile:
    """Returns the same profile with a hemisphere at its end."""
    to_apex_m = np.clip(length_m - np.arange(profile.size.size) / POINTS_PER_M, 0.0, radius_m)
    return AxialProfile(profile.amount, np.sqrt(np.maximum(1.0 - (1.0 - to_apex_m / radius_m) ** 2, 0.0)))


def catheter_tube(
    construction: CatheterConstruction, length_m: float, seed: int, px_per_m: float, blur_px: float
) -> Tube:
    """Makes a catheter: a shaft of loaded polymer with a steel braid and copper wires, platinum rings, a domed tip.

    Args:
        construction: materials and measures of the catheter.
        length_m: length, base to apex.
        seed: seed of the unevenness along the shaft.
        px_per_m: scale of the image at the isocentre.
        blur_px: standard deviation of the aperture.

    Returns:
        The tube.
    """
    lumen_share = 1.0 - construction.wall
    # Layers add up: the braid replaces polymer in a thin layer in the middle of the wall.
    polymer, braid_share = loaded_polymer_per_m(construction.barium_sulphate), 0.5 * (1.0 + lumen_share)
    shaft = (
        _BLOOD,
        Layer(lumen_share, 1.0, polymer),
        Layer(braid_share - 0.03, braid_share + 0.03, construction.braid * PER_M["steel"] - polymer),
        Layer(0.0, lumen_share, construction.core * PER_M["copper"]),
    )
    ring_section = (*shaft, _sleeve(0.10e-3, construction.radius_m))
    tip_section = (*shaft, _sleeve(0.28e-3, construction.radius_m))
    sections, last_end_m = _banded(length_m, construction.rings_m)
    sections += [
        (last_end_m, length_m - construction.electrode_m, 0, 1.0),
        (length_m - construction.electrode_m, length_m, 2, 1.0),
    ]
    profile = axial_profile(length_m, sections, 3)
    rng = np.random.default_rng([seed, 11])
    knots = np.linspace(0.0, length_m, max(4, int(length_m / 4e-3)))
    # The shaft's density varies along it: its growth from point to point is scaled by a smooth random factor.
    uneven = CubicSpline(knots, rng.normal(0, 0.5, knots.size))(np.arange(profile.size.size) / POINTS_PER_M)
    profile.amount[0] = np.cumsum(
        np.diff(profile.amount[0], prepend=0.0) * np.maximum(1.0 + construction.uneven * uneven, 0.1)
    )
    table = section_profiles([shaft, ring_section, tip_section], construction.radius_m, px_per_m, blur_px)
    return Tube(construction.radius_m, table, _dome(profile, length_m, construction.radius_m))


def sheath_tube(construction: CatheterConstruction, length_m: float, px_per_m: float, blur_px: float) -> Tube:
    """Makes the sheath around the shaft, with a marker band near its mouth; the shaft goes on inside.

    Args:
        construction: materials and measures of the catheter.
        length_m: length of the sheath, from its mouth backwards.
        px_per_m: scale of the image at the isocentre.
        blur_px: standard deviation of the aperture.

    Returns:
        The tube; its arc length starts at the mouth.
    """
    radius = construction.radius_m + 0.85e-3
    inner_share = (construction.radius_m + 0.2e-3) / radius
    polymer = loaded_polymer_per_m(0.2)
    lumen_share = (1.0 - construction.wall) * construction.radius_m / radius
    wall = (  # the sheath's polymer and braid, then the catheter's wall and wires inside
        _BLOOD,
        Layer(inner_share, 1.0, polymer),
        Layer(0.5 + 0.5 * inner_share, 0.55 + 0.45 * inner_share, 0.5 * PER_M["steel"]),
        Layer(lumen_share, construction.radius_m / radius, loaded_polymer_per_m(construction.barium_sulphate)),
        Layer(0.0, lumen_share, construction.core * PER_M["copper"]),
    )
    band = (*wall, _sleeve(0.08e-3, radius))
    sections: Sections = [(0.0, 1.5e-3, 0, 1.0), (1.5e-3, 3.0e-3, 1, 1.0), (3.0e-3, length_m, 0, 1.0)]
    return Tube(radius, section_profiles([wall, band], radius, px_per_m, blur_px), axial_profile(length_m, sections, 2))


def instrument_tube(instrument: Instrument, length_m: float, px_per_m: float, blur_px: float) -> Tube:
    """Makes a wire, a diagnostic catheter, a defibrillator's lead or an ultrasound probe.

    Args:
        instrument: kind and radius of the instrument.
        length_m: length of its path.
        px_per_m: scale of the image at the isocentre.
        blur_px: standard deviation of the aperture.

    Returns:
        The tube.
    """
    radius_m = instrument.radius_m
    materials: list[tuple[Layer, ...]]
    sections: Sections
    if instrument.kind == "wire":
        materials = [(_BLOOD, Layer(0.0, 0.68, PER_M["nitinol"]), Layer(0.68, 1.0, 0.6 * PER_M["steel"]))]
        sections = [(0.0, length_m, 0, 1.0)]
    elif instrument.kind in ("electrodes", "tube"):
        shaft = (
            _BLOOD,
            Layer(0.65, 1.0, loaded_polymer_per_m(instrument.barium_sulphate)),
            Layer(0.0, 0.65, 0.04 * PER_M["copper"]),
        )
        materials = [shaft, (*shaft, _sleeve(0.12e-3, radius_m))]
        sections, last_end_m = _banded(length_m, instrument.electrodes_m)
        if last_end_m < length_m:
            sections.append((last_end_m, length_m, 0, 1.0))
    elif instrument.kind == "diagnostic":  # from the apex back: electrodes in pairs, 2 mm and 5 mm apart
        shaft = (_BLOOD, Layer(0.6, 1.0, loaded_polymer_per_m(0.22)), Layer(0.0, 0.6, 0.05 * PER_M["copper"]))
        materials = [shaft, (*shaft, _sleeve(0.1e-3, radius_m))]
        sections, end = [], length_m
        for k in range(10 if radius_m > 0.85e-3 else 4):
            electrode_m = 2e-3 if k == 0 else 1e-3
            start = end - electrode_m
            sections += [(start, end, 1, 1.0), (start - (2e-3 + 3e-3 * (k % 2)), start, 0, 1.0)]
            end = sections[-1][0]
        sections.append((0.0, end, 0, 1.0))
    elif instrument.kind == "lead":
        body = (_BLOOD, Layer(0.0, 0.5, 0.35 * PER_M["steel"]), Layer(0.5, 1.0, PER_M["polymer"]))
        materials = [body, (*body, Layer(0.85, 1.0, 0.5 * PER_M["platinum"]))]
        coil_m = length_m - 62e-3
        sections = [(0.0, coil_m, 0, 1.0), (coil_m, coil_m + 48e-3, 1, 1.0)]  # the shock coil
        sections += [(coil_m + 48e-3, length_m - 2e-3, 0, 1.0), (length_m - 2e-3, length_m, 1, 1.0)]  # the tip
    else:  # the probe: its metal head, and thin rings behind it
        body = (_BLOOD, Layer(0.8, 1.0, PER_M["polymer"]), Layer(0.55, 0.75, 0.12 * PER_M["steel"]))
        materials = [body, (*body, Layer(0.0, 0.8, 0.10 * PER_M["steel"]))]
        sections = [(0.0, length_m, 0, 1.0), (length_m - 32e-3, length_m - 4e-3, 1, 1.0)]
        sections += [(x, x + 2e-3, 1, 0.5) for x in np.arange(length_m - 80e-3, length_m - 36e-3, 6e-3)]
    profile = axial_profile(length_m, sections, len(materials))
    return Tube(radius_m, section_profiles(materials, radius_m, px_per_m, blur_px), _dome(profile, length_m, radius_m))


def instrument_path(instrument: Instrument) -> tuple[FloatArray, FloatArray, float]:
    """Returns points (n, 3) along an instrument at rest, the relative sway (n,) of each, and the length in metres.

    The points are uniform in arc length, in the patient's frame in metres.
    """
    knots = np.array(instrument.knots)
    knot_arc_m = arc_length(knots)
    spline = CubicSpline(knot_arc_m, knots)
    dense = spline(np.linspace(0.0, knot_arc_m[-1], 2000))
    dense_arc_m = arc_length(dense)
    count = math.ceil(dense_arc_m[-1] / 1.5e-3) + 1
    even_arc_m = np.linspace(0.0, dense_arc_m[-1], count)
    points = np.stack([np.interp(even_arc_m, dense_arc_m, dense[:, k]) for k in range(3)], axis=1)
    return points, (even_arc_m / dense_arc_m[-1]) ** 2, float(dense_arc_m[-1])


def swayed(
    instrument: Instrument, points_m: FloatArray, share: FloatArray, rhythm: Rhythm, time_s: float
) -> FloatArray:
    """Moves an instrument with heart and breath.

    Args:
        instrument: its sway and its phase.
        points_m: (n, 3) points at rest, patient's frame.
        share: (n,) relative sway of each point.
        rhythm: rates of heart and breath, and the way of the diaphragm.
        time_s: time on the scene's clock.

    Returns:
        (n, 3) points, patient's frame, in metres.
    """
    beat = rhythm.beating(time_s + instrument.phase / rhythm.heart_hz) - 0.5
    breath = np.array([0.0, 0.0, -0.35 * rhythm.breath_m * rhythm.breath(time_s)])
    return points_m + share[:, None] * (beat * np.array(instrument.sway_m) + breath)
