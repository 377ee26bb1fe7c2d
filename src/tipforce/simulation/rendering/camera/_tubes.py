"""The catheter and the second instrument as tubes to draw: what they are made of along their length, how they lie."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray
from ._profile import TubeProfile, tube_profile
from ._project import Focus, TubeNodes, project_tube
from ._scene import CameraScene, CatheterLook, Instrument
from ._tube import POINTS_PER_M

__all__ = ["Tube", "instrument_shape", "make_instrument", "make_tube"]

Picture = npt.NDArray[np.float32]

_BEHIND_M = 50e-3
"""A tube goes on straight for this far behind its base: its shadow may be in the picture where it is not."""
_IN_FRONT_M, _BEHIND_SHARE = 5e-3, 0.4
"""How far the second instrument lies before the catheter, or what share of the way down to the ground behind it."""
_NODES = 33


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """What never changes about a tube that is drawn every frame; arrays as `add_tube` takes them."""

    length_m: float
    radius_m: float
    profile: TubeProfile
    blurs: FloatArray
    along: Picture

    def nodes(self, shapes_m: FloatArray, camera: CameraModel, focus: Focus) -> TubeNodes:
        """Where to draw the tube with ``shapes_m`` (m, n, 3)."""
        return project_tube(shapes_m, self.length_m, self.radius_m, _BEHIND_M, camera, focus)


def make_tube(
    scene: CameraScene, look: CatheterLook, length_m: float, px_per_m: float, focus: Focus, depth_m: float, seed: int
) -> Tube:
    """A tube of ``length_m`` seen at about ``depth_m`` from the camera."""
    # The tables reach from the sharpest to the most blurred that the tube can come to be by leaving its plane.
    near = [focus.sigma_px(depth_m + off) for off in (-12e-3, 0.0, 12e-3)]
    blurs = (0.97 * focus.sharp_px, 1.05 * max(near) + 0.05)
    light = scene.light
    profile = tube_profile(light.lamps, light.ambient, look.finish, look.radius_m * px_per_m, blurs)
    along = _materials(look, length_m, 3 if scene.colour else 1, near[1] / px_per_m, seed)
    return Tube(length_m, look.radius_m, profile, np.array(blurs), along)


def _materials(look: CatheterLook, length_m: float, channels: int, sigma_m: float, seed: int) -> Picture:
    """(m, 2 c + 1): what matte light, metal light and gloss are worth by arc length, blurred as the picture is."""
    rng = np.random.default_rng([seed, 4])
    s = (np.arange(int((length_m + 1e-3) * POINTS_PER_M)) + 0.5) / POINTS_PER_M
    back = length_m - s
    bands = [(-1.0, look.electrode_m), *look.rings_m]
    metal = np.zeros(s.size)
    joint = np.zeros(s.size)
    for low, high in bands:
        metal = np.maximum(metal, ((back > low) & (back <= high)).astype(float))
        for edge in (low, high):
            joint = np.maximum(joint, look.seam * (np.abs(back - edge) < 6e-5))
    rough = np.interp(np.arange(s.size), np.linspace(0, s.size, 64), rng.standard_normal(64))
    fine = np.interp(np.arange(s.size), np.linspace(0, s.size, 400), rng.standard_normal(400))
    worn = np.maximum(0.2, 1.0 + look.wear * (0.7 * rough + 0.4 * fine))
    shaft, bright = (np.array(colour) for colour in (look.finish.shaft, look.finish.metal))
    if channels == 1:
        weights = np.array([0.299, 0.587, 0.114])
        shaft, bright = np.array([shaft @ weights]), np.array([bright @ weights])
    matte = ((1 - metal) * worn * (1 - joint))[:, None] * shaft
    mirror = (metal * (1 + 0.3 * look.wear * fine) * (1 - joint))[:, None] * bright
    table = np.concatenate([matte, mirror, ((1 - metal) * (1 - joint))[:, None]], axis=1).astype(np.float32)
    steps = sigma_m * POINTS_PER_M
    size = 2 * math.ceil(4 * steps) + 1
    kernel = cv2.getGaussianKernel(size, steps, cv2.CV_32F)
    soft = cv2.sepFilter2D(table, -1, np.ones(1, np.float32), kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(soft, np.float32)


def instrument_shape(scene: CameraScene, instrument: Instrument, time_s: float) -> FloatArray:
    """(33, 3): the second instrument's axis in the base frame at ``time_s``, metres."""
    height = _IN_FRONT_M if instrument.in_front else -_BEHIND_SHARE * scene.ground.depth_m
    share = np.linspace(0.0, 1.0, _NODES)
    start, end = np.array(instrument.start_m), np.array(instrument.end_m)
    way = end - start
    side = np.array([-way[1], way[0]]) / np.hypot(*way)
    sway = instrument.sway_m * math.sin(2 * math.pi * instrument.sway_hz * time_s + instrument.phase_rad)
    aside = instrument.bow_m * 4 * share * (1 - share) + sway * share**2
    flat = start + share[:, None] * way + aside[:, None] * side
    return np.concatenate([flat, np.full((_NODES, 1), height)], axis=1)


def make_instrument(scene: CameraScene, px_per_m: float, focus: Focus, depth_m: float) -> Tube | None:
    """The scene's second instrument, if there is one."""
    instrument = scene.instrument
    if instrument is None:
        return None
    shape = instrument_shape(scene, instrument, 0.0)
    length = float(np.linalg.norm(np.diff(shape, axis=0), axis=1).sum())
    return make_tube(scene, instrument.look, length, px_per_m, focus, depth_m - shape[0, 2], scene.seed + 1)
