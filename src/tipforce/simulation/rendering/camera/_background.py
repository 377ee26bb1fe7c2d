"""The table under the catheter, its lighting, and the objects on it. Numbers in the code are usual sizes and levels."""

import math
from collections.abc import Callable

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from ....types import FloatArray
from ._canvas import FINER, FloatImage, Patch, SceneCanvas, multi_scale_noise, soften
from ._scene import BackgroundAppearance, CameraScene

_ATTEMPTS = 12
"""Largest number of positions that are drawn for an object until one keeps clear of the catheter."""
_COVERED = 0.12
"""Share of a pixel from which an object counts as being there; it ignores the rim of the blur."""
_FRONT_FINER = 4
"""Image pixels for each pixel of the small image of objects near the camera: they are out of focus."""
MIN_FRONT_DISTANCE_M = 9e-3
"""Smallest distance of objects near the camera from the axis of the unbent catheter, without their blur."""
Colour = tuple[float, float, float]
_CABLES: tuple[Colour, ...] = (
    (38, 38, 40), (40, 62, 130), (150, 42, 40), (170, 168, 160), (60, 60, 62), (190, 160, 60),
)  # fmt: skip
_BLOCKS: tuple[Colour, ...] = ((45, 46, 50), (150, 150, 152), (190, 188, 182), (70, 72, 80))
_METAL_GRAIN_PX = (60.0, 0.8)
"""Blur of the noise along the brushing and across it (standard deviations): it makes long, thin scratches."""
_METAL_BLOTCHES_PX = (120.0, 400.0)
"""Scales of the uneven brightness of the plate."""
_METAL_BLOTCHES_FALL = 0.7
"""Weight of the finer of these scales relative to the coarser one."""
_MOST_STREAKS = 3
"""Largest number of streaks on a metal plate; the smallest is 1."""
_STREAK_MIDDLE_M = (-0.02, 0.12)
"""Range of the position at which the middle of a streak meets the line y = 0 of the turned axes of the plate."""
_STREAK_WIDTH_M = (6e-3, 30e-3)
"""Range of the distance from the middle of a streak at which its brightness is 1/e of that in the middle."""
_STREAK_SLANT = 0.1
"""Shift of a streak toward smaller x for each metre of y."""


def _turned(points: FloatArray, turn_rad: float, centre: FloatArray) -> FloatArray:
    """Returns ``points`` (n, 2), turned by ``turn_rad`` about the origin and then moved by ``centre`` (2,)."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return points @ np.array([[c, s], [-s, c]]) + centre


def _rectangle(length: float, width: float) -> FloatArray:
    """Returns the (4, 2) corners of a rectangle about the origin."""
    return np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2


def _screw(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a socket head cap screw from above, sometimes on a washer, at ``centre_px`` (2,), canvas pixels."""
    radius_px = rng.uniform(2.2e-3, 4.5e-3) * canvas.px_per_m
    steel = rng.uniform(70, 170)  # grey level
    if rng.random() < 0.4:
        cover = canvas.disc(centre_px, 1.7 * radius_px)
        canvas.lay(cover, (165, 164, 160), height_m=0.8e-3, shading=canvas.bevel(cover, 1.5))
    cover = canvas.disc(centre_px, radius_px)
    height_m = radius_px / canvas.px_per_m
    canvas.lay(cover, (steel, steel, 1.02 * steel), height_m=height_m, shading=canvas.bevel(cover, 2.0))
    corners_rad = rng.uniform(0, 2 * math.pi) + np.arange(6) * math.pi / 3
    socket = canvas.outline(centre_px + 0.52 * radius_px * np.stack([np.cos(corners_rad), np.sin(corners_rad)], axis=1))
    canvas.lay(socket, (0.25 * steel, 0.25 * steel, 0.25 * steel))


def _cable(canvas: SceneCanvas, rng: np.random.Generator, passed_px: FloatArray) -> None:
    """Paints a wavy cable through ``passed_px`` (2,), canvas pixels, with a highlight on its side to the first lamp."""
    h = canvas.transmittance.shape[0]
    direction_rad = rng.uniform(0, 2 * math.pi)
    direction = np.array([math.cos(direction_rad), math.sin(direction_rad)])
    # Nine knots over 2.8 image heights, each moved at random: both ends are beyond the image's border.
    knots = np.array([passed_px + direction * k * 0.35 * h for k in range(-4, 5)]) + rng.normal(0, 0.07 * h, (9, 2))
    knots[4] = passed_px
    path = CubicSpline(np.arange(9), knots)(np.linspace(0, 8, 160))
    if rng.random() < 0.5:
        path = path[:80]  # this cable ends at the point
    width_px = rng.uniform(1.4e-3, 4.5e-3) * canvas.px_per_m
    colour = _CABLES[int(rng.integers(len(_CABLES)))]
    cover = canvas.outline(path, closed=False, width=width_px)
    canvas.lay(cover, colour, height_m=width_px / canvas.px_per_m, shading=canvas.bevel(cover, 0.3 * width_px))
    lamp = canvas.scene.light.lamps[0].direction
    bright_line = canvas.outline(path + 0.25 * width_px * np.array(lamp[:2]), closed=False, width=0.22 * width_px)
    blur_px = max(0.7, 0.12 * width_px)
    highlight_part = cover.joined(bright_line).around(5.0 * blur_px + 2.0)
    highlight = np.asarray(cv2.GaussianBlur(bright_line.within(highlight_part), (0, 0), blur_px), np.float32)
    highlight = Patch.of(cover.shape, highlight_part, highlight * cover.within(highlight_part))
    canvas.lay(highlight.times(rng.uniform(0.15, 0.6)), (225, 225, 220))


def _ruler(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a ruler with a tick every millimetre and a number every centimetre, at ``centre_px`` (2,), canvas px."""
    per_mm = canvas.px_per_m * 1e-3
    turn_rad = rng.uniform(0, 2 * math.pi)
    length_px, width_px = rng.uniform(60, 160) * per_mm, rng.uniform(13, 26) * per_mm
    grey = rng.uniform(150, 225)
    cover = canvas.outline(_turned(_rectangle(length_px, width_px), turn_rad, centre_px))
    canvas.lay(cover, (grey, grey, grey * rng.uniform(0.8, 1.0)), height_m=0.8e-3, shading=canvas.bevel(cover, 1.5))
    for tick_mm in range(int(length_px / per_mm) - 2):
        # A tick is 2.2 mm long, 3.6 mm every 5 mm, and 5 mm every 10 mm.
        tick_px = (2.2 + 1.4 * (tick_mm % 5 == 0) + 1.4 * (tick_mm % 10 == 0)) * per_mm
        x = -length_px / 2 + (tick_mm + 1.5) * per_mm
        tick = _turned(np.array([[x, -width_px / 2], [x, -width_px / 2 + tick_px]]), turn_rad, centre_px)
        _stroke(canvas, tick, 0.16 * per_mm, 30.0)
        if tick_mm % 10 == 0:
            start = _turned(np.array([[x, -width_px / 2 + 7.2 * per_mm]]), turn_rad, centre_px)[0]
            _write(canvas, str(tick_mm // 10), start, turn_rad, 2.6 * per_mm)


def _stroke(canvas: SceneCanvas, points: FloatArray, width: float, level: float) -> None:
    """Paints a thin straight line of grey ``level`` in the box around it only: a ruler has hundreds of them.

    ``points`` (2, 2): its ends, canvas pixels; ``width``: in canvas pixels, where less than 1 is a fainter line.
    """
    h, w = canvas.transmittance.shape
    u0, v0 = np.maximum(np.floor(points.min(axis=0)).astype(int) - 3, 0)
    u1, v1 = np.minimum(np.ceil(points.max(axis=0)).astype(int) + 4, (w, h))
    if u1 <= u0 or v1 <= v0:
        return
    v, u = np.mgrid[v0:v1, u0:u1]
    direction = points[1] - points[0]
    length = float(np.hypot(*direction))
    share = np.clip(((u - points[0, 0]) * direction[0] + (v - points[0, 1]) * direction[1]) / length**2, 0, 1)
    distance = np.hypot(u - points[0, 0] - share * direction[0], v - points[0, 1] - share * direction[1])
    cover = np.clip(width / 2 + 0.5 - distance, 0.0, min(1.0, width))[..., None].astype(np.float32)
    patch = canvas.levels[v0:v1, u0:u1]
    patch += cover * (np.float32(level) - patch)
    canvas.changed.append((slice(v0, v1), slice(u0, u1)))


def _write(canvas: SceneCanvas, text: str, start_px: FloatArray, turn_rad: float, height_px: float) -> None:
    """Paints ``text`` in ink, ``height_px`` canvas pixels high, from ``start_px`` (2,) on, turned by ``turn_rad``."""
    font, font_scale = cv2.FONT_HERSHEY_SIMPLEX, 2.0
    (text_width, text_height), _ = cv2.getTextSize(text, font, font_scale, 4)
    # The letters are drawn large and then shrunk, because OpenCV cannot draw turned text.
    letters = np.zeros((text_height + 24, text_width + 16), np.uint8)
    cv2.putText(letters, text, (8, text_height + 8), font, font_scale, 255, 4, cv2.LINE_AA)
    scale_to_canvas = height_px / text_height
    letters = cv2.GaussianBlur(letters, (0, 0), max(0.5, 0.4 / scale_to_canvas))
    c, s = scale_to_canvas * math.cos(turn_rad), scale_to_canvas * math.sin(turn_rad)
    to_canvas = np.array([[c, -s, start_px[0]], [s, c, start_px[1]]])
    h, w = letters.shape
    part = canvas.box(np.array([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]]) @ to_canvas.T, 2.0)
    if part[0].start < part[0].stop and part[1].start < part[1].stop:
        ink = cv2.warpAffine(letters, to_canvas, (part[1].stop, part[0].stop))[part].astype(np.float32)
        canvas.lay(Patch.of(canvas.shape, part, ink / np.float32(255.0)).times(0.9), (35, 35, 40))


def _label(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a slip of paper with two to four lines of random letters at ``centre_px`` (2,), canvas pixels."""
    per_mm = canvas.px_per_m * 1e-3
    turn_rad = rng.uniform(-0.5, 0.5)
    width_px, lines = rng.uniform(18, 40) * per_mm, int(rng.integers(2, 5))
    letter_px = rng.uniform(1.6, 2.8) * per_mm
    height_px = (1.9 * lines + 1.2) * letter_px  # a line every 1.9 letter heights, and the margins
    grey = rng.uniform(180, 235)
    cover = canvas.outline(_turned(_rectangle(width_px, height_px), turn_rad, centre_px))
    canvas.lay(cover, (grey, grey, grey * rng.uniform(0.75, 1.0)), height_m=0.25e-3)
    letters = np.array(list("ABCDEFHKLMNPRSTUVX0123456789-. "))
    for line in range(lines):
        text = "".join(rng.choice(letters, max(3, int(width_px / letter_px * 0.9))))
        start = np.array([[-width_px / 2 + letter_px * 0.6, -height_px / 2 + (1.9 * line + 0.4) * letter_px]])
        start = _turned(start, turn_rad, centre_px)[0]
        _write(canvas, text, start, turn_rad, letter_px)


def _tape(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a strip of tape with torn ends, more or less transparent, at ``centre_px`` (2,), canvas pixels."""
    per_mm = canvas.px_per_m * 1e-3
    length_px, width_px = rng.uniform(15, 70) * per_mm, rng.uniform(8, 20) * per_mm
    turn_rad = rng.uniform(0, 2 * math.pi)
    across = np.linspace(-0.5, 0.5, 9)  # nine points across each end, in widths of the tape
    roughness_px = rng.normal(0, 0.5 * per_mm, (2, 9))
    right_end = np.stack([length_px / 2 + roughness_px[0], across * width_px], axis=1)
    left_end = np.stack([-length_px / 2 + roughness_px[1], -across * width_px], axis=1)
    cover = canvas.outline(_turned(np.concatenate([right_end, left_end]), turn_rad, centre_px))
    colours: tuple[Colour, ...] = ((205, 195, 160), (60, 62, 66), (215, 213, 205), (60, 90, 140))
    opacity = rng.uniform(0.35, 0.95)
    canvas.lay(cover.times(opacity), colours[int(rng.integers(4))], height_m=0.15e-3, shading=canvas.bevel(cover, 1.2))


def _block(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a clamp or bracket, a box with two screws, at ``centre_px`` (2,), canvas pixels."""
    per_mm = canvas.px_per_m * 1e-3
    size_px = rng.uniform((14, 10), (45, 26)) * per_mm
    turn_rad = rng.uniform(-0.4, 0.4) + rng.integers(0, 4) * math.pi / 2  # about parallel to the borders
    cover = canvas.outline(_turned(_rectangle(*size_px), turn_rad, centre_px))
    colour = _BLOCKS[int(rng.integers(len(_BLOCKS)))]
    canvas.lay(cover, colour, height_m=rng.uniform(4e-3, 14e-3), shading=canvas.bevel(cover, 2.5))
    for offset in (-0.3, 0.3):
        _screw(canvas, rng, _turned(np.array([[offset * size_px[0], 0.0]]), turn_rad, centre_px)[0])


def _pen(canvas: SceneCanvas, rng: np.random.Generator, centre_px: FloatArray) -> None:
    """Paints a shaky line of a pen through ``centre_px`` (2,), canvas pixels."""
    turn_rad, length_px = rng.uniform(0, 2 * math.pi), rng.uniform(15e-3, 70e-3) * canvas.px_per_m
    direction = np.array([math.cos(turn_rad), math.sin(turn_rad)])
    tremor_px = np.cumsum(rng.normal(0, 0.6, (30, 2)), axis=0)
    line = centre_px + np.linspace(-0.5, 0.5, 30)[:, None] * length_px * direction + tremor_px
    ink = canvas.outline(line, closed=False, width=rng.uniform(1.5, 4.0))
    canvas.lay(ink.times(rng.uniform(0.5, 0.9)), (40, 42, 60))


_OBJECTS: tuple[Callable[[SceneCanvas, np.random.Generator, FloatArray], None], ...] = (
    _screw, _cable, _ruler, _label, _tape, _block, _pen, _screw, _cable,
)  # fmt: skip


def _distance_px(axis_px: FloatArray, shape: tuple[int, int], every: int = 1) -> FloatArray:
    """Returns the distance of every ``every``-th pixel of a canvas from a straight line.

    Args:
        axis_px: (2, 2) ends of the line, canvas pixels.
        shape: (h, w) of the canvas.
        every: step between the pixels, in both directions.

    Returns:
        (h / every, w / every) distances in canvas pixels.
    """
    v, u = np.mgrid[0 : shape[0] : every, 0 : shape[1] : every]
    start, direction = axis_px[0], axis_px[1] - axis_px[0]
    along_u, along_v = u - start[0], v - start[1]
    share = (along_u * direction[0] + along_v * direction[1]) / (direction @ direction)
    share = np.clip(share, 0.0, 1.0)  # of the line, where it is nearest to the pixel
    return np.hypot(along_u - share * direction[0], along_v - share * direction[1])


def lay_objects(canvas: SceneCanvas, rng: np.random.Generator, axis_px: FloatArray) -> None:
    """Paints the scene's objects at random positions on the table.

    With ``clear_m`` above 0, an object that would be nearer than that to the axis (without its shadow) is moved.

    Args:
        canvas: canvas with the painted table.
        rng: random numbers of the objects.
        axis_px: (2, 2) base and unbent tip of the catheter, image pixels.
    """
    h, w = canvas.transmittance.shape
    clear_px = canvas.scene.ground.clear_m * canvas.px_per_m
    near = _distance_px(axis_px * FINER, (h, w), every=4) < clear_px
    before = canvas.levels.copy()
    for _ in range(canvas.scene.ground.objects):
        paint = _OBJECTS[int(rng.integers(len(_OBJECTS)))]
        for _ in range(_ATTEMPTS):
            canvas.transmittance[:] = 1.0
            canvas.changed.clear()
            paint(canvas, rng, rng.uniform((0.0, 0.0), (w, h)))
            # A shadow leaves some of the light of the surface below; the object itself leaves nothing.
            clear_of_axis = not (canvas.transmittance[::4, ::4][near] < _COVERED).any()
            # The object is kept (copied into `before`) or removed; only the painted parts are copied, to save time.
            target, source = (before, canvas.levels) if clear_of_axis else (canvas.levels, before)
            for part in canvas.changed:
                target[part] = source[part]
            if clear_of_axis:
                break
    canvas.transmittance[:] = 0.0


def paint_front_objects(
    scene: CameraScene, width: int, height: int, px_per_m: float, axis_px: FloatArray
) -> tuple[FloatImage, FloatImage]:
    """Paints the objects near the camera, which are out of focus, at a quarter of the image's size.

    They keep clear of the catheter as objects on the table do.

    Args:
        scene: the scene.
        width: width of the image in px.
        height: height of the image in px.
        px_per_m: scale of the image.
        axis_px: (2, 2) base and unbent tip of the catheter, image pixels.

    Returns:
        (3, h, w) levels, and (h, w) share of the view that the objects leave free.
    """
    rng = np.random.default_rng([scene.seed, 5])
    small = (-(-width // _FRONT_FINER), -(-height // _FRONT_FINER))
    canvas = SceneCanvas.empty(*small, px_per_m / _FRONT_FINER, scene)
    h, w = canvas.transmittance.shape
    near = _distance_px(axis_px * FINER / _FRONT_FINER, (h, w)) < MIN_FRONT_DISTANCE_M * canvas.px_per_m
    for _ in range(scene.front_objects):
        paint = _OBJECTS[int(rng.integers(len(_OBJECTS)))]
        for _ in range(_ATTEMPTS):
            before = canvas.levels.copy(), canvas.transmittance.copy()
            paint(canvas, rng, rng.uniform((0.0, 0.0), (w, h)))
            if not (canvas.transmittance[near] < 1.0 - _COVERED).any():
                break
            canvas.levels[:], canvas.transmittance[:] = before
    levels, left = canvas.seen(scene.front_blur_px / _FRONT_FINER)
    size = width, height
    large = [cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR) for plane in (*levels, left)]
    return np.stack(large[:3]).astype(np.float32), np.asarray(large[3], np.float32)


def _grid(canvas: SceneCanvas, turn: float) -> tuple[FloatImage, FloatImage]:
    """Returns the coordinates x and y, (h, w) each, of the canvas's pixels in metres, along axes turned by ``turn``.

    They are 0 in the middle of the upper left pixel.
    """
    h, w = canvas.transmittance.shape
    v, u = np.mgrid[0:h, 0:w].astype(np.float32) / np.float32(canvas.px_per_m)
    c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
    return c * u + s * v, c * v - s * u


def _board(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w) of a painted board in grey levels: blotches, grain, scratches, specks of dust."""
    h, w = canvas.transmittance.shape
    level = multi_scale_noise(rng, (h, w), (5.0, 20.0, 90.0, 350.0), 0.55) * appearance.texture_grey  # blotches
    grain = cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), 1.6)
    level += grain * (1.6 * appearance.texture_grey)
    for _ in range(int(rng.integers(2, 14))):  # scratches, slightly bent
        start = rng.uniform((0, 0), (w, h))
        turn, length_px = rng.uniform(0, 2 * math.pi), rng.uniform(30, 500)
        along = np.linspace(0, length_px, 12)[:, None] * np.array([math.cos(turn), math.sin(turn)])
        aside = rng.uniform(-0.08, 0.08) * np.linspace(0, 1, 12)[:, None] ** 2 * length_px
        line = canvas.outline(start + along + aside * np.array([-math.sin(turn), math.cos(turn)]), closed=False)
        level[line.part] += line.values * rng.uniform(-1.0, 0.7) * (appearance.lines_grey * 0.5)
    for _ in range(int(rng.integers(10, 70))):  # specks of dust
        speck = canvas.disc(rng.uniform((0, 0), (w, h)), rng.uniform(0.5, 2.2))
        level[speck.part] += speck.values * rng.uniform(-1.0, 0.4) * appearance.lines_grey
    return level


def _cloth(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w) of woven cloth with soft folds in grey levels; its threads are not quite straight."""
    h, w = canvas.transmittance.shape
    x, y = _grid(canvas, rng.uniform(0, math.pi))
    threads_rad_per_m = np.float32(2 * math.pi / rng.uniform(0.7e-3, 1.3e-3))  # rad/m
    waver_m = np.float32(1.5e-4)  # m, standard deviation by which a thread leaves its straight line
    warp = np.sin(threads_rad_per_m * (x + waver_m * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    weft = np.sin(threads_rad_per_m * (y + waver_m * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    weave = warp * weft + 0.35 * (np.abs(warp) - np.abs(weft))
    folds = multi_scale_noise(rng, (h, w), (160.0, 420.0), 0.5)
    relief = cv2.Sobel(folds, cv2.CV_32F, 1, 1, ksize=3) * 300.0
    roughness = multi_scale_noise(rng, (h, w), (3.0, 9.0, 40.0), 0.8)
    level = weave * appearance.lines_grey * 0.4 + (folds + relief + roughness) * appearance.texture_grey
    return level.astype(np.float32)


def _paper(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w) of millimetre paper in grey levels: thin lines every mm, stronger every 5 and 10."""
    h, w = canvas.transmittance.shape
    level = multi_scale_noise(rng, (h, w), (4.0, 30.0, 250.0), 0.6) * (0.6 * appearance.texture_grey)
    for axis in _grid(canvas, rng.uniform(-0.08, 0.08)):
        for pitch_m, weight in ((1e-3, 0.25), (5e-3, 0.35), (10e-3, 0.55)):
            # Distance of a pixel from the nearest line, in canvas pixels.
            distance_px = np.abs((axis / np.float32(pitch_m) + 0.5) % 1.0 - 0.5) * np.float32(pitch_m * canvas.px_per_m)
            level -= appearance.lines_grey * weight * np.exp(-((distance_px / np.float32(0.9)) ** 2))
    return level


_HOLE_PITCH_M = 25e-3
"""Distance of the holes of an optical breadboard."""


def _breadboard(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w) of a finely brushed metal table in grey levels, with tapped holes every 25 mm."""
    h, w = canvas.transmittance.shape
    brushed = cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), sigmaX=40.0, sigmaY=0.8)
    level = brushed / brushed.std() * (0.6 * appearance.texture_grey)
    level += multi_scale_noise(rng, (h, w), (30.0, 120.0, 400.0), 0.7) * appearance.texture_grey
    turn_rad = rng.uniform(-0.1, 0.1)
    first_hole_m = rng.uniform(0, 25e-3, 2)
    # Position of a pixel from the nearest hole, in distances of two holes: -0.5 to 0.5.
    from_hole_x, from_hole_y = (
        ((axis - np.float32(offset_m)) / np.float32(_HOLE_PITCH_M) + 0.5) % 1.0 - 0.5
        for axis, offset_m in zip(_grid(canvas, turn_rad), first_hole_m, strict=True)
    )
    distance_px = np.hypot(from_hole_x, from_hole_y) * np.float32(_HOLE_PITCH_M * canvas.px_per_m)
    radius_px = 3.2e-3 * canvas.px_per_m
    hole = np.clip(radius_px + 0.5 - distance_px, 0.0, 1.0)
    ring = np.exp(-(((distance_px - 1.12 * radius_px) / (0.10 * radius_px)) ** 2))
    chamfer = ring * (0.3 + from_hole_x + from_hole_y)  # brighter towards the lower right
    dark = 0.72 + 0.12 * np.sin(distance_px * np.float32(2.4)) + 0.5 * from_hole_y  # with the rings of the thread
    surface_grey = np.asarray(appearance.colour, np.float32).mean()
    return (level + chamfer * appearance.lines_grey * 1.5) * (1 - hole) - hole * surface_grey * dark


def _printed(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w) of a printed sheet in grey levels: lines of text, bars and frames, somewhat askew."""
    h, w = canvas.transmittance.shape
    per_mm = canvas.px_per_m * 1e-3
    ink = np.zeros((h, w), np.uint8)
    letters = np.array(list("abcdefghiklmnoprstuvxyzABDEFGHKLMNPRST 0123456789  ,.-"))
    letter_px = rng.uniform(1.5, 4.5) * per_mm
    font_scale, line_pitch_px = letter_px / 22.0, rng.uniform(1.7, 2.6) * letter_px  # letters are 22 px at scale 1
    for v in np.arange(rng.uniform(0, line_pitch_px), 1.5 * h, line_pitch_px).astype(int).tolist():
        if rng.random() < 0.2:
            continue  # an empty line
        text = "".join(rng.choice(letters, max(4, int(1.2 * w / letter_px))))
        cv2.putText(ink, text, (int(rng.uniform(-0.3, 0.5) * w), v), cv2.FONT_HERSHEY_SIMPLEX, font_scale, 255,
                    max(1, round(0.1 * letter_px)), cv2.LINE_AA)  # fmt: skip
    for _ in range(int(rng.integers(0, 6))):
        corner = rng.uniform((0, 0), (w, h))
        opposite = corner + rng.uniform(4, 45, 2) * per_mm
        filled = rng.random() < 0.4
        cv2.rectangle(ink, corner.astype(int).tolist(), opposite.astype(int).tolist(), int(rng.uniform(60, 255)),
                      cv2.FILLED if filled else max(1, round(0.4 * per_mm)), cv2.LINE_AA)  # fmt: skip
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), float(rng.choice([0, 90, 180, 270]) + rng.uniform(-9, 9)), 1.5)
    ink = cv2.warpAffine(ink, turn, (w, h), flags=cv2.INTER_LINEAR)
    level = multi_scale_noise(rng, (h, w), (4.0, 30.0, 250.0), 0.6) * (0.4 * appearance.texture_grey)
    return (level - ink.astype(np.float32) * np.float32(2.5 * appearance.lines_grey / 255.0)).astype(np.float32)


def _metal(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture of a plate of brushed metal, with the streaks in which it mirrors the lamps.

    Args:
        canvas: canvas of the image; only its size (h, w) and its scale are used.
        appearance: grey levels of the scratches and of the streaks.
        rng: random numbers.

    Returns:
        (h, w) difference from the mean grey level of the plate, in grey levels.
    """
    h, w = canvas.transmittance.shape
    brushed_along_x = rng.random() < 0.5
    blur_x_px, blur_y_px = _METAL_GRAIN_PX if brushed_along_x else _METAL_GRAIN_PX[::-1]
    noise = rng.standard_normal((h, w), np.float32)
    scratches = cv2.GaussianBlur(noise, (0, 0), sigmaX=blur_x_px, sigmaY=blur_y_px)
    level = scratches / scratches.std() * appearance.texture_grey
    x, y = _grid(canvas, float(rng.uniform(0, math.pi)))
    for _ in range(int(rng.integers(1, _MOST_STREAKS + 1))):
        middle_m, width_m = rng.uniform(*_STREAK_MIDDLE_M), rng.uniform(*_STREAK_WIDTH_M)
        across = (x - np.float32(middle_m) + _STREAK_SLANT * y) / np.float32(width_m)
        level += np.exp(-(across**2)) * appearance.lines_grey
    blotches = multi_scale_noise(rng, (h, w), _METAL_BLOTCHES_PX, _METAL_BLOTCHES_FALL)
    return (level + blotches * appearance.texture_grey).astype(np.float32)


def _room(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture (h, w), in grey levels, of the room far behind the bench: patches, all out of focus."""
    h, w = canvas.transmittance.shape
    level = np.zeros((h, w), np.float32)
    for _ in range(int(rng.integers(8, 22))):
        centre_px, size_px = rng.uniform((0, 0), (w, h)), rng.uniform(0.04, 0.35, 2) * w
        turn_rad = rng.uniform(0, math.pi)
        patch = canvas.outline(_turned(_rectangle(*size_px.tolist()), turn_rad, centre_px))
        level[patch.part] += patch.values * np.float32(rng.uniform(-1.4, 1.4) * appearance.lines_grey)
    return soften(level, float(rng.uniform(0.012, 0.03)) * w)


GROUNDS = {
    "board": _board,
    "cloth": _cloth,
    "paper": _paper,
    "breadboard": _breadboard,
    "printed": _printed,
    "metal": _metal,
    "room": _room,
}


def paint_background(scene: CameraScene, width: int, height: int, px_per_m: float, axis_px: FloatArray) -> SceneCanvas:
    """Paints the table and the objects on it, at light 1.

    Args:
        scene: the scene.
        width: width of the image in px.
        height: height of the image in px.
        px_per_m: scale of the image at the table.
        axis_px: (2, 2) base and unbent tip of the catheter, image pixels.

    Returns:
        The canvas.
    """
    rng = np.random.default_rng([scene.seed, 1])
    canvas = SceneCanvas.empty(width, height, px_per_m, scene)
    texture = GROUNDS[scene.ground.kind](canvas, scene.ground, rng)
    colour = np.asarray(scene.ground.colour, np.float32)
    # Unevenness of the surface is unevenness of the light it sends back: it keeps the surface's own colour.
    canvas.levels[:] = colour * (1.0 + texture[..., None] / np.float32(max(colour.mean(), 1.0)))
    np.maximum(canvas.levels, 0.0, out=canvas.levels)
    canvas.transmittance[:] = 0.0
    lay_objects(canvas, rng, axis_px)
    return canvas


def illumination(scene: CameraScene, width: int, height: int) -> FloatImage:
    """Returns the brightness of the light at each pixel, vignetting of the lens included.

    Args:
        scene: the scene.
        width: width of the image in px.
        height: height of the image in px.

    Returns:
        (h, w) relative brightness, at least 0.02; 1 is the middle of an even light of level 1.
    """
    light = scene.light
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    x = (u - 0.5 * (width - 1)) / np.float32(0.5 * width)
    y = (v - 0.5 * (height - 1)) / np.float32(0.5 * width)
    lit = 1.0 + 0.5 * light.gradient * (math.cos(light.gradient_rad) * x + math.sin(light.gradient_rad) * y)
    # The lamp's pool of light is a Gaussian with a standard deviation of 0.35 image widths.
    square_distance = (u / width - light.spot_at[0]) ** 2 + ((v / height - light.spot_at[1]) * height / width) ** 2
    lit += light.spot * (np.exp(-square_distance / np.float32(2 * 0.35**2)) - 0.5)
    square_corner = 1.0 + (height / width) ** 2
    # The cosine-to-the-fourth law and the lens's barrel, as one.
    lens_transmission = (1.0 - light.vignetting * ((x**2 + y**2) / square_corner) ** 1.3).astype(np.float32)
    return np.maximum(light.level * lit * lens_transmission, 0.02).astype(np.float32)
