"""Layers of a varied patient, of usual sizes: bone texture, airways, gas, contrast, pacemaker; the table moves them."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray
from ._anatomy import Blob, Part, heart_blobs, solid_tube
from ._scene import XrayScene
from ._tube_model import ATTENUATION_PER_M as PER_M
from ._variety import Injection, PatientVariety

FloatImage = npt.NDArray[np.float32]
_VESSEL_OVER_CHAMBER = 8.0
"""Contrast agent is less diluted in a vessel than in a chamber."""
_MOST_PER_M = 160.0
"""Largest linear attenuation of a filled vessel over blood."""
_FULL_RADIUS_MM = 1.2
"""In a wider vessel the agent is more diluted, in proportion to the radius."""


@dataclass(frozen=True, slots=True, eq=False)
class VariedLayers:
    """The layers of a varied scene in one view, as attenuation.

    Attributes:
        still: (h + 2 m, w + 2 m) parts that move with the table only, with margin m.
        injected: (h + 2 m, w + 2 m) attenuation by the contrast agent, which moves with the heart; None without it.
        shutter: (h, w) collimator.
        patient_px_per_m: (2, 3) motion in the image by a displacement of the patient, at the isocentre.
    """

    still: FloatImage
    injected: FloatImage | None
    shutter: FloatImage
    patient_px_per_m: FloatArray


def texture(rng: np.random.Generator, contrast: float, px_per_m: float, height: int, width: int) -> FloatImage:
    """Draws the texture of spongy bone: factors (h, w) around 1, with grains of 0.5 to 4 mm along the trabeculae.

    Args:
        rng: random numbers of the texture.
        contrast: its standard deviation, nearly.
        px_per_m: scale of the image at the isocentre.
        height: height in px.
        width: width in px.

    Returns:
        The factors, at least 0.2.
    """
    total = np.zeros((height, width), np.float32)
    # Width of a grain, its length over its width, and its weight.
    for grain_m, elongation, weight in ((0.5e-3, 3.0, 0.45), (1.2e-3, 2.0, 0.6), (4e-3, 1.5, 0.65)):
        grain_px = max(grain_m * px_per_m, 1.0)
        shape = (max(4, math.ceil(height / (grain_px * elongation))), max(4, math.ceil(width / grain_px)))
        noise = rng.standard_normal(shape, dtype=np.float32)
        total += np.float32(weight) * cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.maximum(1.0 + np.float32(contrast) * total, 0.2).astype(np.float32)


def airway_parts(patient: PatientVariety, rng: np.random.Generator) -> list[Part]:
    """Makes trachea and main bronchi, which are brighter than their surroundings.

    Args:
        patient: contrast of the airways.
        rng: random numbers of the patient.

    Returns:
        The parts in the patient's frame, in metres.
    """
    per_m = -0.9 * patient.airways * PER_M["soft_tissue"]
    carina = np.array([rng.normal(-2, 3), 28 + rng.normal(0, 3), 62 + rng.normal(0, 6)])
    top = carina + np.array([rng.normal(0, 3), -6.0, 90.0])
    right, left = carina + np.array([-34.0, 4.0, -22.0]), carina + np.array([44.0, 6.0, -26.0])
    # The trachea divides at the carina into the two main bronchi: points and radii in mm.
    airways = [(top, carina, 7.5), (carina, right, 5.5), (carina, left, 5.0)]
    return [solid_tube(np.array([start, 0.5 * (start + end), end]), radius, per_m) for start, end, radius in airways]


def gas_blobs(patient: PatientVariety, dome_m: float, rng: np.random.Generator) -> list[Blob]:
    """Makes the gas in stomach and bowel below the left dome of the diaphragm, as positive attenuation to subtract.

    Args:
        patient: number of bubbles.
        dome_m: height of the diaphragm.
        rng: random numbers of the patient.

    Returns:
        The bubbles.
    """
    blobs: list[Blob] = []
    for _ in range(patient.gas):
        half = rng.uniform((10e-3, 10e-3, 6e-3), (32e-3, 26e-3, 20e-3))
        middle = (rng.uniform(20e-3, 80e-3), rng.uniform(-40e-3, 10e-3), dome_m - rng.uniform(12e-3, 45e-3))
        blobs.append(Blob(middle, (float(half[0]), float(half[1]), float(half[2])), 0.7 * PER_M["soft_tissue"]))
    return blobs


def chamber_blobs(scene: XrayScene, injection: Injection) -> list[Blob]:
    """Makes the chambers that the contrast agent of ``injection`` fills, as ellipsoids in the patient's frame."""
    chambers = heart_blobs(scene.anatomy)
    blobs: list[Blob] = []
    for chamber in (chambers[k] for k in injection.chambers):
        x, y, z = chamber.half_m
        blobs.append(Blob(chamber.middle_m, (0.8 * x, 0.8 * y, 0.8 * z), injection.per_m))  # inside the wall
    return blobs


def vessel_parts(injection: Injection, rng: np.random.Generator) -> list[Part]:
    """Makes filled vessels on the heart, of the width of a catheter and up to that of the aorta.

    Args:
        injection: number of vessels and their attenuation.
        rng: random numbers of the patient.

    Returns:
        The parts in the patient's frame, in metres.
    """
    per_m = min(_VESSEL_OVER_CHAMBER * injection.per_m, _MOST_PER_M)
    parts: list[Part] = []
    for _ in range(injection.vessels):
        start_mm = rng.normal((5, 0, 20), (14, 14, 12))
        direction = rng.normal(size=3)
        radius_mm = 0.6 * 10.0 ** rng.uniform(0.0, 1.0)
        knots_mm = [start_mm]
        for _ in range(5):
            direction = direction / np.linalg.norm(direction) + rng.normal(0, 0.45, 3)
            knots_mm.append(knots_mm[-1] + rng.uniform(8, 14) * direction / np.linalg.norm(direction))
        parts.append(solid_tube(np.array(knots_mm), radius_mm, per_m * min(1.0, _FULL_RADIUS_MM / radius_mm)))
    return parts


def add_can(patient: PatientVariety, drawn: FloatImage, camera: CameraModel) -> None:
    """Adds a pacemaker's can: a flat titanium case with battery, coil and a connector block of resin.

    Args:
        patient: position and rotation of the can.
        drawn: (h, w) attenuation that is changed.
        camera: camera model; its world is the patient's frame.
    """
    if patient.can is None:
        return
    around_rad = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    # A rounded rectangle: |x|^4 + |y|^4 = 1.
    fourth_power = np.abs(np.cos(around_rad)) ** 4 + np.abs(np.sin(around_rad)) ** 4
    rounded = np.column_stack([np.cos(around_rad), np.sin(around_rad)]) / fourth_power[:, None] ** 0.25
    shapes = [  # outline in mm, thickness in mm, attenuation: case, battery, coil, connector block, its two contacts
        (rounded * (22.0, 20.0), 6.0, 0.9),
        (rounded * (10.0, 17.0) + (-9.0, -1.0), 5.0, 1.8),
        (rounded * (7.0, 12.0) + (11.0, 2.0), 4.0, 0.7),
        (rounded * (20.0, 6.0) + (0.0, 25.0), 8.0, 0.35),
        (rounded * (6.0, 1.6) + (-6.0, 25.0), 3.0, 1.6),
        (rounded * (6.0, 1.6) + (9.0, 25.0), 3.0, 1.6),
    ]
    spin = math.radians(patient.can_turn_deg)
    right, up = np.array([math.cos(spin), 0.0, math.sin(spin)]), np.array([-math.sin(spin), 0.0, math.cos(spin)])
    for outline, thickness_mm, attenuation in shapes:
        flat = np.array(patient.can) + 1e-3 * (outline[:, :1] * right + outline[:, 1:] * up)
        half_depth = np.array([0.0, 0.5e-3 * thickness_mm, 0.0])
        solid = np.concatenate([flat - half_depth, flat + half_depth])
        hull = cv2.convexHull(camera.project(solid).astype(np.float32))
        mask = np.zeros(drawn.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.round(16 * hull).astype(np.int32), 255, cv2.LINE_AA, 4)
        drawn += np.float32(attenuation) * mask.astype(np.float32) / 255.0


def shifted_still(layers: VariedLayers, margin: int, shift_px: FloatArray, shape: tuple[int, int]) -> FloatImage:
    """Returns the attenuation (h, w) of the layers that move with the table only.

    Args:
        layers: layers of the view.
        margin: m in px.
        shift_px: (2,) displacement of the patient in the image.
        shape: (h, w).

    Returns:
        The attenuation.
    """
    u, v = margin - shift_px
    still = layers.still
    if not shift_px.any():
        return still[margin : margin + shape[0], margin : margin + shape[1]] + layers.shutter
    return np.asarray(warped(still, np.array([[1.0, 0.0, u], [0.0, 1.0, v]]), shape) + layers.shutter, np.float32)


def moved_contrast(
    injected: FloatImage, margin: int, size: float, middle_px: FloatArray, shift_px: FloatArray, shape: tuple[int, int]
) -> FloatImage:
    """Returns the attenuation (h, w) of the contrast agent in the beating heart.

    Args:
        injected: see `VariedLayers`.
        margin: m in px.
        size: relative size of the heart.
        middle_px: (2,) middle of the heart at rest.
        shift_px: (2,) displacement of the heart in the image.
        shape: (h, w).

    Returns:
        The attenuation.
    """
    back = 1.0 / size
    u, v = middle_px * (1.0 - back) - back * shift_px + margin
    return warped(injected, np.array([[back, 0.0, u], [0.0, back, v]]), shape)


def warped(layer: FloatImage, source_from_result: FloatArray, shape: tuple[int, int]) -> FloatImage:
    """Returns a layer of ``shape`` whose pixel p is that of ``layer`` at ``source_from_result`` (2, 3) times (p, 1)."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size, border = shape[::-1], cv2.BORDER_REPLICATE
    return np.asarray(cv2.warpAffine(layer, source_from_result, size, flags=flags, borderMode=border), np.float32)
