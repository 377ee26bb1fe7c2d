"""A tube as the camera sees it: shading tables across it, materials along it, its axis projected through the lens."""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from ....geometry import CameraModel
from ....types import FloatArray
from ._scene import CameraScene, CatheterAppearance, Instrument, Lamp, TubeFinish
from ._tube_kernels import NODE_SIZE, POINTS_PER_M, STEPS_PER_PX, add_tube

FloatImage = npt.NDArray[np.float32]
_DIRECTIONS, _BLURS = 64, 5
"""Directions of the axis and blurs in a shading table; between them it is interpolated."""
_CELLS = 96
"""Strips of equal angle around the visible half of a tube; each has one brightness."""


@dataclass(frozen=True, slots=True, eq=False)
class TubeProfile:
    """Shading tables of a tube.

    Attributes:
        table: (blur, direction, across, 4) cover; matte light, gloss and metal light times cover; gloss in grey levels,
            the others as a share. Direction of the axis: a whole turn.
        half_width_px: half the width of the tube.
        reach_px: the table reaches across from minus this to this.
        blur_px: smallest and largest standard deviation of the blur.
    """

    table: FloatImage
    half_width_px: float
    reach_px: float
    blur_px: tuple[float, float]


def _lobe(normal: FloatArray, lamp: Lamp, sharpness: float) -> FloatArray:
    """Returns the highlight of ``lamp`` where ``normal`` (..., 3) is halfway between it and the camera."""
    half = np.array(lamp.direction) + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    return np.maximum(0.0, normal @ half) ** sharpness


def _shade(normal: FloatArray, lamps: tuple[Lamp, ...], ambient: float, finish: TubeFinish) -> FloatArray:
    """Returns the light of surfaces with ``normal`` (..., 3: right, down, to the camera) as (..., 3).

    Matte light is relative to that of a face turned to the camera, gloss is in grey levels, and metal is the factor on
    the metal's level.
    """
    light_at_facing = ambient + sum(lamp.strength * lamp.direction[2] for lamp in lamps)
    matte = ambient * (0.6 + 0.4 * normal[..., 2])
    gloss = finish.rim_grey * (1.0 - normal[..., 2]) ** 4
    mirrored_z = 2.0 * normal[..., 2] ** 2 - 1.0
    # Brushed metal mirrors a room that is bright above, dark at the level of the table, and grey where the table is.
    metal = 0.55 + 0.25 * mirrored_z + 0.25 * (1.0 - normal[..., 2]) ** 3
    for lamp in lamps:
        # A lamp of some size still lights a face that is turned a little away from its middle.
        lit = np.maximum(0.0, normal @ np.array(lamp.direction) + 0.15) / 1.15
        matte = matte + lamp.strength * lit
        gloss = gloss + finish.gloss_grey * lamp.strength * _lobe(normal, lamp, finish.sharpness)
        metal = metal + 0.75 * lamp.strength * _lobe(normal, lamp, finish.metal_sharpness)
    return np.stack([matte / light_at_facing, gloss, metal], axis=-1)


def tube_profile(
    lamps: tuple[Lamp, ...], ambient: float, finish: TubeFinish, half_width_px: float, blur_px: tuple[float, float]
) -> TubeProfile:
    """Makes the shading tables of a tube.

    Args:
        lamps: the lamps.
        ambient: light from all directions, in the unit of the lamps' strength.
        finish: colours and gloss of the tube.
        half_width_px: half the width of the tube in the image.
        blur_px: smallest and largest standard deviation of the image's blur.

    Returns:
        The tables.
    """
    reach = math.ceil(half_width_px + 4.0 * blur_px[1]) + 1.0
    across_px = np.linspace(-reach, reach, 2 * int(reach) * STEPS_PER_PX + 1)
    edges = np.sin(np.linspace(-math.pi / 2, math.pi / 2, _CELLS + 1))  # of the strips, in half widths
    centres = np.sin(np.linspace(-math.pi / 2, math.pi / 2, 2 * _CELLS + 1)[1::2])
    direction_rad = 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    normal = np.empty((_DIRECTIONS, _CELLS, 3))
    normal[..., 0] = -np.sin(direction_rad)[:, None] * centres
    normal[..., 1] = np.cos(direction_rad)[:, None] * centres
    normal[..., 2] = np.sqrt(1.0 - centres**2)
    values = np.concatenate([np.ones((_DIRECTIONS, _CELLS, 1)), _shade(normal, lamps, ambient, finish)], axis=-1)
    table = np.empty((_BLURS, _DIRECTIONS, across_px.size, 4), np.float32)
    for k, sigma in enumerate(np.linspace(*blur_px, _BLURS)):
        # The blurred strip is the difference of its two blurred edges (Gaussian distribution functions).
        past_edge = ndtr((across_px[:, None] - half_width_px * edges) / sigma)
        table[k] = np.einsum("xc,dcq->dxq", past_edge[:, :-1] - past_edge[:, 1:], values, optimize=True)
    return TubeProfile(table, half_width_px, reach, blur_px)


NODE_DISTANCE_M = 1.2e-3
"""Approximate distance of the nodes: 6 px at 0.2 mm/px."""


@dataclass(frozen=True, slots=True)
class Focus:
    """Blur of a point by its depth: sigma^2 = ``sharp_px``^2 + (``px_per_m`` (depth - ``depth_m``))^2.

    Attributes:
        sharp_px: smallest standard deviation of the blur.
        depth_m: distance of the sharpest plane from the camera, along its axis.
        px_per_m: increase of the blur with the distance from that plane.
    """

    sharp_px: float
    depth_m: float
    px_per_m: float

    def sigma_px(self, depth_m: float) -> float:
        """Returns the standard deviation of the blur at ``depth_m`` from the camera."""
        return math.hypot(self.sharp_px, self.px_per_m * (depth_m - self.depth_m))


@dataclass(frozen=True, slots=True, eq=False)
class TubeNodes:
    """``nodes`` (instants, n, 8), see `NODE_SIZE`; arc length at the first of them and between two of them, metres."""

    nodes: FloatArray
    start_m: float
    step_m: float


@lru_cache(maxsize=64)
def _operators(count: int, at: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Returns matrices (m, count): values and slopes of the spline through ``count`` nodes at ``at``, in steps."""
    spline = CubicSpline(np.arange(count), np.eye(count))
    return spline(np.array(at)), spline(np.array(at), 1)


@njit(cache=True, error_model="numpy", nogil=True)
def _sides(points: FloatArray, slopes_3d: FloatArray, position: FloatArray, radius: float, sides: FloatArray) -> None:
    """Writes into ``sides`` (2, m, 3) the points at which a camera at ``position`` (3,) sees both outlines of a tube.

    ``points``, ``slopes_3d`` (m, 3): axis and its tangents of any length. The ray of the camera touches the tube there:
    normal . (point - position + radius normal) = 0, where the normal is perpendicular to the axis.
    """
    for i in range(points.shape[0]):
        tx, ty, tz = slopes_3d[i, 0], slopes_3d[i, 1], slopes_3d[i, 2]
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx / size, ty / size, tz / size
        x, y, z = points[i, 0] - position[0], points[i, 1] - position[1], points[i, 2] - position[2]
        along = x * tx + y * ty + z * tz
        # (x, y, z): from the camera to the axis, perpendicular to it; n: perpendicular to this and to the axis.
        x, y, z = x - along * tx, y - along * ty, z - along * tz
        distance = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / distance, y / distance, z / distance
        nx, ny, nz = ty * z - tz * y, tz * x - tx * z, tx * y - ty * x
        back = -radius * radius / distance
        side = radius * math.sqrt(1.0 - (radius / distance) ** 2)
        for k in range(2):
            sign = side if k else -side
            sides[k, i, 0] = points[i, 0] + back * x + sign * nx
            sides[k, i, 1] = points[i, 1] + back * y + sign * ny
            sides[k, i, 2] = points[i, 2] + back * z + sign * nz


def project_tube(
    shapes: FloatArray, length_m: float, radius_m: float, behind_m: float, camera: CameraModel, focus: Focus
) -> TubeNodes:
    """Projects a tube into the image: the middle between its two outlines.

    The projected axis is within 0.005 px of this middle. The tube ends in a dome.

    Args:
        shapes: (instants, n, 3) axis, base to the tip's apex, uniform in arc length.
        length_m: length of the axis.
        radius_m: radius of the tube.
        behind_m: length for which the tube goes on straight behind the base.
        camera: camera model whose world is the frame of the shapes.
        focus: blur by depth.

    Returns:
        The nodes of the axis in the image.

    Raises:
        ValueError: the tube reaches behind the camera or beyond the image of its lens.
    """
    count, n = shapes.shape[:2]
    # The last node is the middle of the dome, one radius before the apex.
    stretches = max(4, math.ceil((length_m - radius_m) / NODE_DISTANCE_M))
    step = (length_m - radius_m) / stretches
    node_positions = tuple(float(x) for x in np.arange(stretches + 1) * step / length_m * (n - 1))
    spline_values, spline_slopes = _operators(n, node_positions)
    points = np.empty((count, stretches + 2, 3))
    tangents = np.empty_like(points)
    points[:, 1:] = spline_values @ shapes
    tangents[:, 1:] = (spline_slopes * ((n - 1) * step / length_m)) @ shapes
    tangents[:, 0] = tangents[:, 1]
    points[:, 0] = points[:, 1] - tangents[:, 1] * (behind_m / step)
    points, tangents = points.reshape(-1, 3), tangents.reshape(-1, 3)
    sides = np.empty((2, len(points), 3))
    _sides(points, tangents, camera.position_m, radius_m, sides)
    outline = camera.project(sides.reshape(-1, 3)).reshape(2, -1, 2)
    _, slopes = camera.project_with_slopes(points)
    nodes = np.empty((len(points), NODE_SIZE))
    # Columns of `NODE_SIZE`: position, derivative by the node's number, unit tangent, half width, blur.
    nodes[:, :2] = 0.5 * (outline[0] + outline[1])
    nodes[:, 4:6] = (slopes @ tangents[:, :, None])[:, :, 0]
    nodes[:, 2:4] = nodes[:, 4:6] / np.hypot(nodes[:, 4], nodes[:, 5])[:, None]
    nodes[:, 6] = 0.5 * np.hypot(*(outline[1] - outline[0]).T)
    pose = camera.camera_from_world
    depth = points @ pose.rotation[2] + pose.translation_m[2]
    nodes[:, 7] = np.hypot(focus.sharp_px, focus.px_per_m * (depth - focus.depth_m))
    if not np.isfinite(nodes).all():
        raise ValueError("a tube reaches behind the camera or beyond what its lens can show; is the shape in metres?")
    # The stretch behind the base is longer than the others, but nothing changes along it.
    return TubeNodes(nodes.reshape(count, -1, NODE_SIZE), -step, step)


STRAIGHT_BEHIND_M = 50e-3
"""A tube goes on straight for this length behind its base: its shadow may be in the image while the tube is outside."""
_IN_FRONT_M, _BEHIND_SHARE = 5e-3, 0.4
"""Distance of the second instrument before the catheter, or its share of the way to the ground behind it."""
_NODES = 33


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """The constant parts of a tube that is drawn every frame; arrays as `add_tube` takes them."""

    length_m: float
    radius_m: float
    profile: TubeProfile
    blurs: FloatArray
    along: FloatImage
    blunt: float
    braid: FloatArray

    def nodes(self, shapes_m: FloatArray, camera: CameraModel, focus: Focus) -> TubeNodes:
        """Projects the tube into the image.

        Args:
            shapes_m: (m, n, 3) axis, base to apex, uniform in arc length.
            camera: camera model whose world is the frame of the shapes.
            focus: blur by depth.

        Returns:
            The nodes of the axis in the image.
        """
        return project_tube(shapes_m, self.length_m, self.radius_m, STRAIGHT_BEHIND_M, camera, focus)

    def draw(self, drawn: FloatImage, nodes: TubeNodes) -> None:
        """Adds the mean of the tube over the instants of ``nodes`` to ``drawn``, see `add_tube`."""
        profile = self.profile
        for moment in nodes.nodes:
            add_tube(
                drawn, moment, 1.0 / len(nodes.nodes), profile.table, profile.half_width_px, profile.reach_px,
                self.blurs, nodes.start_m, nodes.step_m, self.along, self.blunt, self.braid,
            )  # fmt: skip


def make_tube(
    scene: CameraScene,
    appearance: CatheterAppearance,
    length_m: float,
    px_per_m: float,
    focus: Focus,
    depth_m: float,
    seed: int,
) -> Tube:
    """Makes the constant parts of a tube.

    Args:
        scene: the scene, for its lamps and its colour.
        appearance: radius, finish and rings of the tube.
        length_m: length of the axis.
        px_per_m: scale of the image at the tube.
        focus: blur by depth.
        depth_m: approximate distance of the tube from the camera.
        seed: seed of the wear along the tube.

    Returns:
        The tube.
    """
    # The tables cover the blur from the sharpest one to that of a tube 12 mm before or behind its plane.
    blurs_px = [focus.sigma_px(depth_m + off) for off in (-12e-3, 0.0, 12e-3)]
    blur_range_px = (0.97 * focus.sharp_px, 1.05 * max(blurs_px) + 0.05)
    light = scene.light
    profile = tube_profile(light.lamps, light.ambient, appearance.finish, appearance.radius_m * px_per_m, blur_range_px)
    along = _materials(appearance, length_m, 3 if scene.colour else 1, blurs_px[1] / px_per_m, seed)
    braid = np.zeros(3)
    if appearance.braid is not None:
        turns_rad_per_m = 2.0 * math.pi / appearance.braid.pitch_m
        remaining = math.exp(-0.5 * (turns_rad_per_m * blurs_px[1] / px_per_m) ** 2)  # contrast after the blur
        braid[:] = appearance.braid.contrast * remaining, turns_rad_per_m, appearance.braid.strands
    return Tube(length_m, appearance.radius_m, profile, np.array(blur_range_px), along, appearance.blunt, braid)


_HALF_SEAM_M = 6e-5
"""Half the length of the dark joint between metal and polymer."""


def _materials(appearance: CatheterAppearance, length_m: float, channels: int, sigma_m: float, seed: int) -> FloatImage:
    """Returns weights (m, 2 c + 1) of matte light, metal light and gloss by arc length, blurred as the image is."""
    rng = np.random.default_rng([seed, 4])
    arc_m = (np.arange(int((length_m + 1e-3) * POINTS_PER_M)) + 0.5) / POINTS_PER_M
    from_apex_m = length_m - arc_m
    bands = [(-1.0, appearance.electrode_m), *appearance.rings_m]
    metal = np.zeros(arc_m.size)
    joint = np.zeros(arc_m.size)
    for low, high in bands:
        metal = np.maximum(metal, ((from_apex_m > low) & (from_apex_m <= high)).astype(float))
        for edge in (low, high):
            joint = np.maximum(joint, appearance.seam * (np.abs(from_apex_m - edge) < _HALF_SEAM_M))
    # Wear of two scales: 64 and 400 random values over the length.
    rough = np.interp(np.arange(arc_m.size), np.linspace(0, arc_m.size, 64), rng.standard_normal(64))
    fine = np.interp(np.arange(arc_m.size), np.linspace(0, arc_m.size, 400), rng.standard_normal(400))
    worn = np.maximum(0.2, 1.0 + appearance.wear * (0.7 * rough + 0.4 * fine))
    shaft, mirror_level = (np.array(colour) for colour in (appearance.finish.shaft, appearance.finish.metal))
    if channels == 1:
        weights = np.array([0.299, 0.587, 0.114])
        shaft, mirror_level = np.array([shaft @ weights]), np.array([mirror_level @ weights])
    matte = ((1 - metal) * worn * (1 - joint))[:, None] * shaft
    mirror = (metal * (1 + 0.3 * appearance.wear * fine) * (1 - joint))[:, None] * mirror_level
    table = np.concatenate([matte, mirror, ((1 - metal) * (1 - joint))[:, None]], axis=1).astype(np.float32)
    blur_steps = sigma_m * POINTS_PER_M
    size = 2 * math.ceil(4 * blur_steps) + 1
    kernel = cv2.getGaussianKernel(size, blur_steps, cv2.CV_32F)
    soft = cv2.sepFilter2D(table, -1, np.ones(1, np.float32), kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(soft, np.float32)


def instrument_shape(scene: CameraScene, instrument: Instrument, time_s: float) -> FloatArray:
    """Returns the axis of another instrument in the image, beside the catheter; z points to the camera.

    Args:
        scene: the scene.
        instrument: the instrument.
        time_s: time that determines its sway.

    Returns:
        (33, 3) points in metres, base frame.
    """
    height = _IN_FRONT_M if instrument.in_front else -_BEHIND_SHARE * scene.ground.depth_m
    share = np.linspace(0.0, 1.0, _NODES)
    start, end = np.array(instrument.start_m), np.array(instrument.end_m)
    direction = end - start
    side = np.array([-direction[1], direction[0]]) / np.hypot(*direction)
    sway = instrument.sway_m * math.sin(2 * math.pi * instrument.sway_hz * time_s + instrument.phase_rad)
    # A parabola whose middle is ``bow_m`` beside the straight line, and a sway that grows toward the end.
    aside = instrument.bow_m * 4 * share * (1 - share) + sway * share**2
    flat = start + share[:, None] * direction + aside[:, None] * side
    return np.concatenate([flat, np.full((_NODES, 1), height)], axis=1)


def make_instrument(scene: CameraScene, px_per_m: float, focus: Focus, depth_m: float) -> Tube | None:
    """Makes the constant parts of the scene's second instrument.

    Args:
        scene: the scene.
        px_per_m: scale of the image at the catheter.
        focus: blur by depth.
        depth_m: distance of the catheter's plane from the camera.

    Returns:
        The instrument's tube; None without one.
    """
    instrument = scene.instrument
    if instrument is None:
        return None
    shape = instrument_shape(scene, instrument, 0.0)
    length = float(np.linalg.norm(np.diff(shape, axis=0), axis=1).sum())
    return make_tube(scene, instrument.appearance, length, px_per_m, focus, depth_m - shape[0, 2], scene.seed + 1)
