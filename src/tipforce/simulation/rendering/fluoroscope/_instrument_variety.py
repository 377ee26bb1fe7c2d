"""Catheters and instruments of all kinds: electrodes, spacing, opacity, routes. Numbers are usual ranges."""

from dataclasses import replace

import numpy as np

from ....types import FloatArray
from ._scene import CatheterConstruction, Instrument
from ._variety import XrayVarietyRanges, count, uniform

_CATHETER_RINGS_M = 40e-3
"""Rings are nearer to the apex than this: the shortest catheter of the presets has 43 mm in front of its base."""
_INSTRUMENT_RINGS_M = 110e-3
"""The shortest route is 125 mm long."""


def varied_catheter(
    ranges: XrayVarietyRanges, made: CatheterConstruction, rng: np.random.Generator
) -> CatheterConstruction:
    """Draws tip electrode, rings, spacing and opacity of a catheter.

    Args:
        ranges: ranges from which they are drawn.
        made: catheter with its diameter and the length of its rigid part as electrode.
        rng: random numbers of the catheter.

    Returns:
        The catheter.
    """
    fitting = [length for length in ranges.tip_electrode_m if length <= made.electrode_m] or [made.electrode_m]
    electrode = float(rng.choice(fitting))
    return replace(
        made,
        electrode_m=electrode,
        rings_m=_ring_positions(electrode, count(rng, ranges.rings), _CATHETER_RINGS_M, rng),
        barium_sulphate=uniform(rng, (0.05, 0.42)),
        wall=uniform(rng, (0.22, 0.34)),
        braid=uniform(rng, (0.05, 0.6)),
        core=uniform(rng, (0.0, 0.08)),
        uneven=uniform(rng, (0.0, 0.15)),
    )


def _ring_positions(
    tip_m: float, number: int, reach_m: float, rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Draws start and end, in m back from the apex, of up to ``number`` rings behind the tip electrode of ``tip_m``.

    They are evenly spaced or in pairs; those that would end farther than ``reach_m`` from the apex are left out.
    """
    ring_m, gap_m = uniform(rng, (0.8e-3, 2.2e-3)), uniform(rng, (1.5e-3, 5e-3))
    other_gap_m = gap_m if rng.random() < 0.5 else uniform(rng, (4e-3, 8e-3))
    rings: list[tuple[float, float]] = []
    position_m = tip_m
    for k in range(number):
        position_m += gap_m if k % 2 == 0 else other_gap_m
        if position_m + ring_m > reach_m:
            break
        rings.append((position_m, position_m + ring_m))
        position_m += ring_m
    return tuple(rings)


def varied_instruments(ranges: XrayVarietyRanges, rng: np.random.Generator) -> tuple[Instrument, ...]:
    """Draws further instruments: electrode catheters of all kinds, some of them like the right one, wires, sheaths.

    Args:
        ranges: ranges of their number.
        rng: random numbers of the scene.

    Returns:
        The instruments.
    """
    instruments: list[Instrument] = []
    for _ in range(count(rng, ranges.instruments)):
        kind = str(rng.choice(["electrodes", "wire", "tube"], p=[0.55, 0.25, 0.2]))
        knots = _route(rng, loop=kind == "electrodes" and rng.random() < 0.15)
        radius = rng.uniform(0.25e-3, 0.45e-3) if kind == "wire" else rng.uniform(0.6e-3, 1.6e-3)
        tip = float(rng.choice([1e-3, 2e-3, 4e-3, 8e-3]))
        rings = _ring_positions(tip, count(rng, (1, 19)), _INSTRUMENT_RINGS_M, rng) if kind == "electrodes" else ()
        sway = rng.normal(size=3) * rng.uniform(0.5e-3, 3e-3)
        instruments.append(
            Instrument(
                kind=kind,
                radius_m=float(radius),
                knots=tuple((float(x), float(y), float(z)) for x, y, z in 1e-3 * knots),
                sway_m=(float(sway[0]), float(sway[1]), float(sway[2])),
                phase=rng.random(),
                electrodes_m=((0.0, tip), *rings) if kind == "electrodes" else (),
                barium_sulphate=uniform(rng, (0.02, 0.4)),
            )
        )
    return tuple(instruments)


def _route(rng: np.random.Generator, loop: bool) -> FloatArray:
    """Draws the knots (k, 3) of an instrument's path in mm, patient's frame, from beyond the image into the heart.

    It comes from below or above, along the large veins. With ``loop`` it ends in a ring of 7 to 13 mm radius.
    """
    below = rng.random() < 0.6
    start = np.array([rng.normal(-20, 12), rng.normal(15, 10), -150.0 if below else 150.0])
    end = np.array([rng.normal(5, 25), rng.normal(-5, 22), rng.normal(0, 25)])
    vein_mouth = np.array([rng.normal(-18, 8), rng.normal(8, 8), -25.0 if below else 30.0])
    middle = 0.5 * (vein_mouth + end) + rng.normal(0, 9, 3)
    knots = [start, 0.5 * (start + vein_mouth) + rng.normal(0, 4, 3), vein_mouth, middle, end]
    if loop:
        radius, along = rng.uniform(7.0, 13.0), (end - middle) / np.linalg.norm(end - middle)
        aside = np.cross(along, rng.normal(size=3))
        aside /= np.linalg.norm(aside)
        across = np.cross(along, aside)
        around_rad = np.linspace(0.8, 6.0, 7)[:, None]
        ring = radius * ((1.0 - np.cos(around_rad)) * aside + np.sin(around_rad) * across) + 0.8 * around_rad * along
        knots.extend(end + ring)
    return np.array(knots)
