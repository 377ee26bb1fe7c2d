"""Differences between X-ray laboratories: collimator, display, table, patient, devices. Numbers are usual ranges."""

import math
from dataclasses import dataclass

import numpy as np

from ....types import FloatArray
from ..._fields import NotNegative, Range, Settings, Share, Some
from ._scene import Point


@dataclass(frozen=True, slots=True)
class Collimator:
    """Limits of the field; lengths are shares of the image's side.

    Attributes:
        inset: distance of the blades from the left, right, top and bottom border; 0: not in view.
        turn_deg: rotation of the blades.
        circle: radius of the round field of an image intensifier; 0: the detector is flat.
        wedge: attenuation of the wedge filter; 0: not in the beam.
        wedge_inset: distance of the wedge's edge from the image's middle.
        wedge_turn_deg: direction of the wedge from the middle.
        wedge_soft: width of the wedge's edge.
    """

    inset: tuple[float, float, float, float]
    turn_deg: float
    circle: float
    wedge: float
    wedge_inset: float
    wedge_turn_deg: float
    wedge_soft: float


@dataclass(frozen=True, slots=True)
class DisplayProcessing:
    """Processing of the images by the vendor; pixels are those of 512 columns.

    Attributes:
        edge_gain: gain of the edge enhancement.
        edge_px: sigma of its low-pass filter.
        flattening: share of the slow differences of brightness that is removed.
        vignetting: loss of brightness in the corners, in grey levels of 256.
        kept: share of the image before in the recursive temporal filter.
        blanked: whether pixels outside of the collimator are black.
        text: number of lines of text in each corner: top left, top right, bottom left, bottom right.
        text_level: grey level of the text.
        boxed: whether the text is on a black box.
        cross: whether a cross marks the middle.
        ruler: whether a ruler is at the right border.
    """

    edge_gain: float
    edge_px: float
    flattening: float
    vignetting: float
    kept: float
    blanked: bool
    text: tuple[int, int, int, int]
    text_level: int
    boxed: bool
    cross: bool
    ruler: bool


@dataclass(frozen=True, slots=True)
class Pan:
    """One motion of the patient relative to a plane, with smooth start and stop; see `pan_m`."""

    start_s: float
    seconds: float
    way_m: Point


@dataclass(frozen=True, slots=True)
class Injection:
    """Contrast agent in the heart.

    Attributes:
        chambers: numbers of the chambers that it fills, in `heart_blobs`.
        per_m: linear attenuation of the filled chamber over blood, 1/m.
        vessels: number of filled vessels.
        start_s: start of the first injection.
        repeat_s: time from one injection to the next.
        washout_s: time constant of the washout.
        rest: share that stays.
    """

    chambers: tuple[int, ...]
    per_m: float
    vessels: int
    start_s: float
    repeat_s: float
    washout_s: float
    rest: float

    def amount(self, time_s: float) -> float:
        """Returns the amount of contrast agent, 0 to 1; it fills within about half a second."""
        age = (time_s - self.start_s) % self.repeat_s
        return self.rest + (1.0 - self.rest) * (1.0 - math.exp(-age / 0.35)) * math.exp(-age / self.washout_s)


@dataclass(frozen=True, slots=True)
class PatientVariety:
    """Parts of the patient beyond `Anatomy`.

    Attributes:
        trabecular: relative contrast of the bones' texture.
        airways: relative contrast of trachea and bronchi.
        gas: number of gas bubbles below the diaphragm.
        can: position of a pacemaker's can from the isocentre, patient's frame; None where there is no pacemaker.
        can_turn_deg: rotation of the can.
        injection: injection of contrast agent; None where nothing is injected.
    """

    trabecular: float
    airways: float
    gas: int
    can: Point | None
    can_turn_deg: float
    injection: Injection | None


@dataclass(frozen=True, slots=True)
class XrayVariety:
    """One draw of `XrayVarietyRanges`.

    Attributes:
        collimators: one a view.
        processing: processing of the images.
        pans: motions of the table or the C-arm; one tuple a view.
        patient: parts of the patient.
    """

    collimators: tuple[Collimator, ...]
    processing: DisplayProcessing
    pans: tuple[tuple[Pan, ...], ...]
    patient: PatientVariety


class XrayVarietyRanges(Settings):
    """Ranges of the differences between X-ray laboratories; shares are those of the sessions."""

    round_field: Share = 0.25
    round_radius: Range = (0.46, 0.62)
    blades: Share = 0.6
    blade_inset: Range = (0.03, 0.16)
    blade_turn_deg: Range = (-3.0, 3.0)
    wedge: Share = 0.25
    wedge_attenuation: Range = (0.4, 1.3)

    edge: Share = 0.75
    edge_gain: Range = (0.3, 1.8)
    edge_px: Range = (0.8, 3.0)
    flattening: Range = (0.0, 0.6)
    temporal: Share = 0.7
    temporal_kept: Range = (0.15, 0.6)
    text: Share = 0.6
    blanked: Share = 0.7

    panned: Share = 0.4
    """Sessions in which the table or a C-arm moves."""
    pan_m: Range = (4e-3, 14e-3)
    pan_s: Range = (0.8, 3.0)

    trabecular: Range = (0.04, 0.25)
    airways: Range = (0.0, 0.8)
    gas: Some = (0, 3)
    can: Share = 0.25
    injection: Share = 0.35
    injection_per_m: Range = (4.0, 25.0)
    vessels: Some = (0, 6)

    depth_m: Range = (-20e-3, 20e-3)
    """Distance of the catheter's base from the isocentre's plane, toward the viewer of the first view."""
    calibration_px: Range = (0.5, 4.0)
    """RMS over the working volume by which the nominal geometry is off, at 512 columns."""
    tip_electrode_m: tuple[NotNegative, ...] = (2e-3, 3.5e-3, 4e-3, 8e-3)
    """The visible tip electrode is one of these; none is longer than the rigid part."""
    rings: Some = (0, 9)
    instruments: Some = (1, 5)
    """Electrode catheters, wires and sheaths in addition to the ``devices``."""


def uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Returns a number that is drawn uniformly within (low, high) ``bounds``."""
    return float(rng.uniform(*bounds))


def count(rng: np.random.Generator, bounds: tuple[int, int]) -> int:
    """Returns a whole number from low to high ``bounds``, each with equal probability."""
    return int(rng.integers(bounds[0], bounds[1] + 1))


def sample_variety(
    ranges: XrayVarietyRanges, rng: np.random.Generator, right: FloatArray, up: FloatArray, views: int
) -> XrayVariety:
    """Draws the differences between laboratories.

    Args:
        ranges: ranges from which it is drawn.
        rng: random numbers of the scene.
        right: (3,) direction of the first image's right in the patient's frame.
        up: (3,) its up.
        views: number of views.

    Returns:
        The draw.
    """
    round_field = rng.random() < ranges.round_field
    radius = uniform(rng, ranges.round_radius) if round_field else 0.0
    return XrayVariety(
        collimators=tuple(_collimator(ranges, rng, radius) for _ in range(views)),
        processing=_processing(ranges, rng, round_field),
        pans=_pans(ranges, rng, right, up, views),
        patient=_patient(ranges, rng, right, up),
    )


def _collimator(ranges: XrayVarietyRanges, rng: np.random.Generator, circle: float) -> Collimator:
    """Draws blades and wedge of one view; ``circle``: radius of its round field, 0 without one."""
    bladed = rng.random() < ranges.blades
    left, right, top, bottom = (
        uniform(rng, ranges.blade_inset) if bladed and rng.random() < 0.6 else 0.0 for _ in range(4)
    )
    wedge = uniform(rng, ranges.wedge_attenuation) if rng.random() < ranges.wedge else 0.0
    return Collimator(
        inset=(left, right, top, bottom),
        turn_deg=uniform(rng, ranges.blade_turn_deg),
        circle=circle,
        wedge=wedge,
        wedge_inset=uniform(rng, (0.1, 0.4)),
        wedge_turn_deg=uniform(rng, (0.0, 360.0)),
        wedge_soft=uniform(rng, (0.02, 0.15)),
    )


def _processing(ranges: XrayVarietyRanges, rng: np.random.Generator, round_field: bool) -> DisplayProcessing:
    """Draws the vendor's processing and the text in the four corners; a round field has darker corners, too."""
    shown = rng.random() < ranges.text
    lines = [int(rng.integers(0, 5)) if shown and rng.random() < 0.6 else 0 for _ in range(4)]
    return DisplayProcessing(
        edge_gain=uniform(rng, ranges.edge_gain) if rng.random() < ranges.edge else 0.0,
        edge_px=uniform(rng, ranges.edge_px),
        flattening=uniform(rng, ranges.flattening),
        vignetting=uniform(rng, (10.0, 45.0)) if round_field else 0.0,
        kept=uniform(rng, ranges.temporal_kept) if rng.random() < ranges.temporal else 0.0,
        blanked=bool(rng.random() < ranges.blanked),
        text=(lines[0], lines[1], lines[2], lines[3]),
        text_level=int(rng.integers(170, 256)),
        boxed=bool(rng.random() < 0.3),
        cross=bool(shown and rng.random() < 0.1),
        ruler=bool(shown and rng.random() < 0.15),
    )


def _pans(
    ranges: XrayVarietyRanges, rng: np.random.Generator, right: FloatArray, up: FloatArray, views: int
) -> tuple[tuple[Pan, ...], ...]:
    """Draws the motions, for each view: of the table, which all views show, or of the C-arm of one view.

    A motion is in the plane of the first image, whose directions ``right`` and ``up`` (3,) are in the patient's frame.
    """
    if rng.random() >= ranges.panned:
        return ((),) * views
    pans: list[Pan] = []
    start_s, seconds = uniform(rng, (1.0, 6.0)), 0.0
    for _ in range(int(rng.integers(1, 4))):
        direction_rad, distance_m = uniform(rng, (0.0, 2.0 * math.pi)), uniform(rng, ranges.pan_m)
        x, y, z = distance_m * (math.cos(direction_rad) * right + math.sin(direction_rad) * up)
        seconds = uniform(rng, ranges.pan_s)
        way_m = (float(x), float(y), float(z))
        pans.append(Pan(start_s, seconds, way_m))
        # the operator pans back, else the catheter would leave the image
        pans.append(Pan(start_s + seconds + uniform(rng, (2.0, 12.0)), seconds, (-way_m[0], -way_m[1], -way_m[2])))
        start_s = pans[-1].start_s + seconds + uniform(rng, (3.0, 15.0))
    moving = int(rng.integers(views)) if views > 1 and rng.random() < 0.4 else None
    return tuple(tuple(pans) if moving in (None, view) else () for view in range(views))


def pan_m(pans: tuple[Pan, ...], time_s: float) -> FloatArray:
    """Returns the patient's displacement (3,) relative to a plane, patient's frame.

    Args:
        pans: motions of this plane.
        time_s: time on the scene's clock.

    >>> pan_m((Pan(1.0, 2.0, (0.01, 0.0, 0.0)),), 2.0)
    array([0.005, 0.   , 0.   ])
    """
    total = np.zeros(3)
    for pan in pans:
        share = min(max((time_s - pan.start_s) / pan.seconds, 0.0), 1.0)
        total += share * share * (3.0 - 2.0 * share) * np.array(pan.way_m)
    return total


def _patient(ranges: XrayVarietyRanges, rng: np.random.Generator, right: FloatArray, up: FloatArray) -> PatientVariety:
    """Draws bone texture, airways, gas, a pacemaker and contrast agent; ``right``, ``up``: see `sample_variety`."""
    can = None
    if rng.random() < ranges.can:
        # at the border of the first image, and near the skin
        right_m, up_m = rng.choice([-1.0, 1.0]) * rng.uniform(45e-3, 75e-3), rng.uniform(15e-3, 75e-3)
        x, y, z = right_m * right + up_m * up
        can = (float(x), float(y) - 0.04, float(z))
    injection = None
    if rng.random() < ranges.injection:
        chambers = rng.choice(6, size=int(rng.integers(0, 3)), replace=False)
        vessels = count(rng, ranges.vessels)
        injection = Injection(
            chambers=tuple(int(k) for k in chambers),
            per_m=uniform(rng, ranges.injection_per_m),
            vessels=vessels,
            start_s=uniform(rng, (-6.0, 6.0)),
            repeat_s=uniform(rng, (8.0, 30.0)),
            washout_s=uniform(rng, (1.5, 8.0)),
            rest=uniform(rng, (0.0, 0.4)),
        )
    return PatientVariety(
        trabecular=uniform(rng, ranges.trabecular),
        airways=uniform(rng, ranges.airways),
        gas=count(rng, ranges.gas),
        can=can,
        can_turn_deg=uniform(rng, (0.0, 360.0)),
        injection=injection,
    )
