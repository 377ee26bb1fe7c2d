"""All that is painted once a session and view, as attenuation."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, IntArray
from ._anatomy import Blob, Part, chest_parts, heart_blobs, liver_blobs, spine_parts
from ._collimator import collimator_attenuation
from ._instruments import catheter_tube, instrument_path, instrument_tube, sheath_tube
from ._patient_variety import VariedLayers, add_can, airway_parts, chamber_blobs, gas_blobs, texture, vessel_parts
from ._scene import Instrument, XrayScene
from ._tube_kernels import POINTS_PER_M, FloatImage, no_spans
from ._tube_model import Tube, axial_profile, section_profiles
from ._variety import XrayVariety

COARSE = 4
"""Pixels of the image a pixel of the soft layers."""
_MARGIN = 0.25
"""By how much of the image's size the moving layers reach over its border, on each side."""


@dataclass(frozen=True, slots=True, eq=False)
class MovingInstrument:
    """A `Instrument` ready to be drawn."""

    instrument: Instrument
    tube: Tube
    points_m: FloatArray
    share: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class StaticLayers:
    """One view's still parts, as attenuation.

    Attributes:
        camera: camera model; its world is the base frame.
        patient_camera: camera model; its world is the patient's frame.
        px_per_m: scale at the isocentre.
        catheter: the catheter.
        devices: other instruments.
        still: (h, w) parts that do not move.
        chest: (h + 2 m, w + 2 m) parts that move with the breath.
        margin: m in px.
        heart: heart, coarser by `COARSE`.
        liver: organs below the diaphragm, coarser by `COARSE`.
        coarse_margin: margin of both in their pixels.
        head_px: (2,) one metre toward the patient's head at the isocentre.
        heart_px: (2,) middle of the heart.
        varied: further layers of a varied scene, whose ``still`` replaces the one here.
    """

    camera: CameraModel
    patient_camera: CameraModel
    px_per_m: float
    catheter: Tube
    devices: tuple[MovingInstrument, ...]
    still: FloatImage
    chest: FloatImage
    margin: int
    heart: FloatImage
    liver: FloatImage
    coarse_margin: int
    head_px: FloatArray
    heart_px: FloatArray
    varied: VariedLayers | None = None


def make_static_layers(scene: XrayScene, view: int, length_m: float, width: int, height: int) -> StaticLayers:
    """Paints everything that does not change from image to image of a view.

    Args:
        scene: the scene.
        view: number of the view.
        length_m: length of the catheter, base to apex.
        width: width of the image in px.
        height: height of the image in px.

    Returns:
        The layers.
    """
    plane = scene.views[view]
    camera, patient = scene.camera(view, width, height), plane.true.camera(width, height)
    px_per_m = width / 512.0 / plane.true.scale_m_per_px
    # Blur of the edges: the focal spot, as large as the magnification shows it, and the pixel's own width.
    focal_blur_px = plane.beam.focal_spot_m * (plane.true.magnification - 1.0) / plane.true.imager_spacing_m(width)
    blur = math.hypot(math.sqrt(1.0 / 12.0), focal_blur_px)
    margin = math.ceil(_MARGIN * width)
    rng = np.random.default_rng([scene.seed, 1])  # the same patient in both views
    wide = _shifted(patient, margin)
    spine, (tissue, metal) = spine_parts(scene.anatomy, rng), chest_parts(scene.anatomy, rng)
    variety_rng = np.random.default_rng([scene.seed, 4])
    chest = np.zeros((height + 2 * margin, width + 2 * margin), np.float32)
    still_margin = margin if scene.variety else 0  # the table moves the still parts, too
    still = np.zeros((height + 2 * still_margin, width + 2 * still_margin), np.float32)
    spans = no_spans(len(still))
    for part in spine:
        _add_part(part, still, spans, _shifted(patient, still_margin), px_per_m, blur)
    for part in tissue:
        _add_part(part, chest, no_spans(len(chest)), wide, px_per_m, blur)
    if scene.variety:
        for layer in (still, chest):
            layer *= texture(variety_rng, scene.variety.patient.trabecular, px_per_m, *layer.shape)
        metal = metal + airway_parts(scene.variety.patient, variety_rng)
        add_can(scene.variety.patient, chest, wide)
    for part in metal:
        _add_part(part, chest, no_spans(len(chest)), wide, px_per_m, blur)
    still += _texture(np.random.default_rng([scene.seed, 2, view]), *still.shape)
    _add_sheath(scene, still, spans, _shifted(camera, still_margin), px_per_m, blur)
    coarse = CameraModel(
        patient.focal_px / COARSE,
        (patient.centre_px - 0.5 * (COARSE - 1)) / COARSE + margin // COARSE,
        camera_from_world=patient.camera_from_world,
    )
    shape = (height // COARSE + 2 * (margin // COARSE), width // COARSE + 2 * (margin // COARSE))
    middle, slopes = patient.project_with_slopes(np.zeros((1, 3)))
    devices: list[MovingInstrument] = []
    for instrument in scene.devices:
        points, share, length = instrument_path(instrument)
        tube = instrument_tube(instrument, length, px_per_m, blur)
        devices.append(MovingInstrument(instrument, tube, points, share))
    liver = _soft(liver_blobs(scene.anatomy), coarse, shape)
    varied = None
    if scene.variety:
        liver -= _soft(gas_blobs(scene.variety.patient, scene.anatomy.dome_m, variety_rng), coarse, shape)
        injected = _injected(scene, scene.variety, variety_rng, coarse, shape, wide, chest.shape, (px_per_m, blur))
        shutter = collimator_attenuation(scene.variety.collimators[view], 0.004 * width, height, width)
        varied = VariedLayers(still, injected, shutter, slopes[0])
        still = still[margin : margin + height, margin : margin + width]
    return StaticLayers(
        camera=camera,
        patient_camera=patient,
        px_per_m=px_per_m,
        catheter=catheter_tube(scene.catheter, length_m, scene.seed, px_per_m, blur),
        devices=tuple(devices),
        still=still,
        chest=chest,
        margin=margin,
        heart=_soft(heart_blobs(scene.anatomy), coarse, shape),
        liver=liver,
        coarse_margin=margin // COARSE,
        head_px=slopes[0, :, 2],
        heart_px=middle[0],
        varied=varied,
    )


def _injected(
    scene: XrayScene,
    variety: XrayVariety,
    rng: np.random.Generator,
    coarse: CameraModel,
    coarse_shape: tuple[int, int],
    wide: CameraModel,
    shape: tuple[int, ...],
    scale: tuple[float, float],
) -> FloatImage | None:
    """Paints the contrast agent in chambers and vessels; returns the attenuation of ``shape``; None: no injection.

    ``coarse``, ``wide``: cameras of the coarse layers and of the layer with margins, whose world is the patient's
    frame; ``scale``: px for each metre at the isocentre, and the blur of the aperture in px.
    """
    injection = variety.patient.injection
    if injection is None:
        return None
    chambers = _soft(chamber_blobs(scene, injection), coarse, coarse_shape)
    chambers = chambers * texture(rng, 0.35, 10.0 * scale[0] / COARSE, *coarse_shape)  # swirls of 5 to 40 mm
    attenuation = np.asarray(cv2.resize(chambers, shape[1::-1], interpolation=cv2.INTER_CUBIC), np.float32)
    for part in vessel_parts(injection, rng):
        _add_part(part, attenuation, no_spans(len(attenuation)), wide, *scale)
    return attenuation


def _shifted(camera: CameraModel, margin: int) -> CameraModel:
    return CameraModel(camera.focal_px, camera.centre_px + margin, camera_from_world=camera.camera_from_world)


def _add_part(
    part: Part, drawn: FloatImage, spans: IntArray, camera: CameraModel, px_per_m: float, blur_px: float
) -> None:
    """Adds the attenuation of a tube of the anatomy to ``drawn`` (h, w); ``spans``: see `Tube.add`."""
    table = section_profiles(part.materials, part.radius_m, px_per_m, blur_px)
    profile = axial_profile(part.length_m, part.sections, len(part.materials))
    arc_m = np.arange(profile.size.size) / POINTS_PER_M
    for start, end, waist in part.waists:
        # A vertebra's waist: narrow in the middle, at x = 0, and with rounded rims, at x = -1 and 1.
        x = np.clip((2.0 * arc_m - start - end) / (end - start), -1.0, 1.0)
        inside = np.abs(x) < 1.0
        profile.size[inside] = (1.0 - waist * (1.0 - x**2) - 0.2 * np.maximum(np.abs(x) - 0.9, 0.0) / 0.1)[inside]
    Tube(part.radius_m, table, profile).add(drawn, spans, camera, part.points_m)


def _add_sheath(
    scene: XrayScene, drawn: FloatImage, spans: IntArray, camera: CameraModel, px_per_m: float, blur_px: float
) -> None:
    """Adds the attenuation of the sheath to ``drawn`` (h, w): 60 mm from the base backwards, gently bent."""
    rng = np.random.default_rng([scene.seed, 3])
    arc_m = np.linspace(0.0, 60e-3, 41)
    bend_y, bend_z = rng.normal(0, 6.0), rng.normal(0, 6.0)
    points = np.stack([-arc_m, 0.5 * bend_y * arc_m**2, 0.5 * bend_z * arc_m**2], axis=1)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    sheath_tube(scene.catheter, length, px_per_m, blur_px).add(drawn, spans, camera, points)


def _texture(rng: np.random.Generator, height: int, width: int) -> FloatImage:
    """Draws slow differences of attenuation (h, w), as of fat, muscle and the table."""
    total = np.zeros((height, width), np.float32)
    for cells, size in ((3, 0.12), (6, 0.05), (14, 0.02), (40, 0.010), (100, 0.006)):
        noise = rng.normal(0, size, (cells, cells)).astype(np.float32)
        total += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return total


def _soft(blobs: list[Blob], camera: CameraModel, shape: tuple[int, int]) -> FloatImage:
    """Returns the attenuation (h, w) of ellipsoids that merge into each other.

    It is a soft maximum over the ellipsoids, the cube root of the sum of cubes, of the attenuation along each ray.
    """
    h, w = shape
    v, u = np.mgrid[0:h, 0:w]
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    origin = camera.position_m
    total: npt.NDArray[np.float64] = np.zeros(h * w)
    for blob in blobs:
        half_m = np.array(blob.half_m)
        start, directions = (origin - np.array(blob.middle_m)) / half_m, rays / half_m
        # In units of the half axes it is a unit sphere; the chord is the difference of the roots of a t^2 + 2 b t + c.
        a, b, c = (directions**2).sum(axis=1), directions @ start, float(start @ start) - 1.0
        chord_m = 2.0 * np.sqrt(np.maximum(b * b - a * c, 0.0)) / a
        total += (blob.per_m * chord_m) ** 3
    return np.asarray(cv2.GaussianBlur(np.cbrt(total).astype(np.float32).reshape(h, w), (0, 0), 0.7), np.float32)
