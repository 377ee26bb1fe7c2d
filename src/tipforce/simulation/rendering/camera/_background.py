"""The table under the catheter: its material, its lighting, and the objects on it."""

import math
from collections.abc import Callable

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from ....types import FloatArray
from ._canvas import FINER, FloatImage, Patch, SceneCanvas, multi_scale_noise, soften
from ._scene import BackgroundAppearance, CameraScene

_ATTEMPTS = 12
_COVERED = 0.12
_FRONT_FINER = 4
MIN_FRONT_DISTANCE_M = 9e-3
"""Smallest distance of objects near the camera from the axis of the unbent catheter, without their blur."""
Colour = tuple[float, float, float]
_CABLES: tuple[Colour, ...] = (
    (38, 38, 40),
    (40, 62, 130),
    (150, 42, 40),
    (170, 168, 160),
    (60, 60, 62),
    (190, 160, 60),
)
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


def _turned(points: FloatArray, turn: float, at: FloatArray) -> FloatArray:
    c, s = math.cos(turn), math.sin(turn)
    return points @ np.array([[c, s], [-s, c]]) + at


def _rectangle(length: float, width: float) -> FloatArray:
    return np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2


def _screw(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a socket head cap screw from above, sometimes on a washer."""
    radius = rng.uniform(2.2e-3, 4.5e-3) * canvas.px_per_m
    steel = rng.uniform(70, 170)
    if rng.random() < 0.4:
        cover = canvas.disc(at, 1.7 * radius)
        canvas.lay(cover, (165, 164, 160), height_m=0.8e-3, shading=canvas.bevel(cover, 1.5))
    cover = canvas.disc(at, radius)
    canvas.lay(cover, (steel, steel, 1.02 * steel), height_m=radius / canvas.px_per_m, shading=canvas.bevel(cover, 2.0))
    turn = rng.uniform(0, 2 * math.pi) + np.arange(6) * math.pi / 3
    socket = canvas.outline(at + 0.52 * radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    canvas.lay(socket, (0.25 * steel, 0.25 * steel, 0.25 * steel))


def _cable(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a cable that comes from beyond the border and wanders past ``at``."""
    h = canvas.transmittance.shape[0]
    turn = rng.uniform(0, 2 * math.pi)
    way = np.array([math.cos(turn), math.sin(turn)])
    knots = np.array([at + way * k * 0.35 * h for k in range(-4, 5)]) + rng.normal(0, 0.07 * h, (9, 2))
    knots[4] = at
    path = CubicSpline(np.arange(9), knots)(np.linspace(0, 8, 160))
    if rng.random() < 0.5:  # it ends here
        path = path[:80]
    width = rng.uniform(1.4e-3, 4.5e-3) * canvas.px_per_m
    colour = _CABLES[int(rng.integers(len(_CABLES)))]
    cover = canvas.outline(path, closed=False, width=width)
    canvas.lay(cover, colour, height_m=width / canvas.px_per_m, shading=canvas.bevel(cover, 0.3 * width))
    lamp = canvas.scene.light.lamps[0].direction
    shine = canvas.outline(path + 0.25 * width * np.array(lamp[:2]), closed=False, width=0.22 * width)
    sigma = max(0.7, 0.12 * width)
    part = cover.joined(shine).around(5.0 * sigma + 2.0)
    soft = np.asarray(cv2.GaussianBlur(shine.within(part), (0, 0), sigma), np.float32)
    soft = Patch.of(cover.shape, part, soft * cover.within(part))
    canvas.lay(soft.times(rng.uniform(0.15, 0.6)), (225, 225, 220))


def _ruler(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a ruler of steel or plastic, with a tick every millimetre and numbers."""
    per_mm = canvas.px_per_m * 1e-3
    turn = rng.uniform(0, 2 * math.pi)
    length, width = rng.uniform(60, 160) * per_mm, rng.uniform(13, 26) * per_mm
    pale = rng.uniform(150, 225)
    cover = canvas.outline(_turned(_rectangle(length, width), turn, at))
    canvas.lay(cover, (pale, pale, pale * rng.uniform(0.8, 1.0)), height_m=0.8e-3, shading=canvas.bevel(cover, 1.5))
    for k in range(int(length / per_mm) - 2):
        tall = (2.2 + 1.4 * (k % 5 == 0) + 1.4 * (k % 10 == 0)) * per_mm
        x = -length / 2 + (k + 1.5) * per_mm
        line = _turned(np.array([[x, -width / 2], [x, -width / 2 + tall]]), turn, at)
        _stroke(canvas, line, 0.16 * per_mm, 30.0)
        if k % 10 == 0:
            _write(
                canvas,
                str(k // 10),
                _turned(np.array([[x, -width / 2 + 7.2 * per_mm]]), turn, at)[0],
                turn,
                2.6 * per_mm,
            )


def _stroke(canvas: SceneCanvas, points: FloatArray, width: float, level: float) -> None:
    """Paints a thin dark line, in its own neighbourhood only (there are hundreds)."""
    h, w = canvas.transmittance.shape
    u0, v0 = np.maximum(np.floor(points.min(axis=0)).astype(int) - 3, 0)
    u1, v1 = np.minimum(np.ceil(points.max(axis=0)).astype(int) + 4, (w, h))
    if u1 <= u0 or v1 <= v0:
        return
    v, u = np.mgrid[v0:v1, u0:u1]
    way = points[1] - points[0]
    size = float(np.hypot(*way))
    share = np.clip(((u - points[0, 0]) * way[0] + (v - points[0, 1]) * way[1]) / size**2, 0, 1)
    off = np.hypot(u - points[0, 0] - share * way[0], v - points[0, 1] - share * way[1])
    cover = np.clip(width / 2 + 0.5 - off, 0.0, min(1.0, width))[..., None].astype(np.float32)
    patch = canvas.levels[v0:v1, u0:u1]
    patch += cover * (np.float32(level) - patch)
    canvas.changed.append((slice(v0, v1), slice(u0, u1)))


def _write(canvas: SceneCanvas, text: str, at: FloatArray, turn: float, tall: float) -> None:
    """Paints ``text`` in ink, ``tall`` px high, from ``at`` on."""
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 2.0
    (width, height), _ = cv2.getTextSize(text, font, scale, 4)
    small = np.zeros((height + 24, width + 16), np.uint8)
    cv2.putText(small, text, (8, height + 8), font, scale, 255, 4, cv2.LINE_AA)
    shrink = tall / height
    small = cv2.GaussianBlur(small, (0, 0), max(0.5, 0.4 / shrink))
    c, s = shrink * math.cos(turn), shrink * math.sin(turn)
    to_canvas = np.array([[c, -s, at[0]], [s, c, at[1]]])
    h, w = small.shape
    part = canvas.box(np.array([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1]]) @ to_canvas.T, 2.0)
    if part[0].start < part[0].stop and part[1].start < part[1].stop:
        ink = cv2.warpAffine(small, to_canvas, (part[1].stop, part[0].stop))[part].astype(np.float32)
        canvas.lay(Patch.of(canvas.shape, part, ink / np.float32(255.0)).times(0.9), (35, 35, 40))


def _label(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a slip of paper with a few lines of print."""
    per_mm = canvas.px_per_m * 1e-3
    turn = rng.uniform(-0.5, 0.5)
    width, lines = rng.uniform(18, 40) * per_mm, int(rng.integers(2, 5))
    tall = rng.uniform(1.6, 2.8) * per_mm
    height = (1.9 * lines + 1.2) * tall
    pale = rng.uniform(180, 235)
    cover = canvas.outline(_turned(_rectangle(width, height), turn, at))
    canvas.lay(cover, (pale, pale, pale * rng.uniform(0.75, 1.0)), height_m=0.25e-3)
    letters = np.array(list("ABCDEFHKLMNPRSTUVX0123456789-. "))
    for k in range(lines):
        text = "".join(rng.choice(letters, max(3, int(width / tall * 0.9))))
        start = _turned(np.array([[-width / 2 + tall * 0.6, -height / 2 + (1.9 * k + 0.4) * tall]]), turn, at)[0]
        _write(canvas, text, start, turn, tall)


def _tape(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a strip of tape with torn ends, more or less transparent."""
    per_mm = canvas.px_per_m * 1e-3
    length, width, turn = rng.uniform(15, 70) * per_mm, rng.uniform(8, 20) * per_mm, rng.uniform(0, 2 * math.pi)
    torn = np.linspace(-0.5, 0.5, 9)
    ends = rng.normal(0, 0.5 * per_mm, (2, 9))
    right = np.stack([length / 2 + ends[0], torn * width], axis=1)
    left = np.stack([-length / 2 + ends[1], -torn * width], axis=1)
    cover = canvas.outline(_turned(np.concatenate([right, left]), turn, at))
    colours: tuple[Colour, ...] = ((205, 195, 160), (60, 62, 66), (215, 213, 205), (60, 90, 140))
    thick = rng.uniform(0.35, 0.95)
    canvas.lay(cover.times(thick), colours[int(rng.integers(4))], height_m=0.15e-3, shading=canvas.bevel(cover, 1.2))


def _block(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a clamp or bracket: a box with two screws."""
    per_mm = canvas.px_per_m * 1e-3
    size = rng.uniform((14, 10), (45, 26)) * per_mm
    turn = rng.uniform(-0.4, 0.4) + rng.integers(0, 4) * math.pi / 2
    cover = canvas.outline(_turned(_rectangle(*size), turn, at))
    colour = _BLOCKS[int(rng.integers(len(_BLOCKS)))]
    canvas.lay(cover, colour, height_m=rng.uniform(4e-3, 14e-3), shading=canvas.bevel(cover, 2.5))
    for side in (-0.3, 0.3):
        _screw(canvas, rng, _turned(np.array([[side * size[0], 0.0]]), turn, at)[0])


def _pen(canvas: SceneCanvas, rng: np.random.Generator, at: FloatArray) -> None:
    """Paints a line of a pen."""
    turn, length = rng.uniform(0, 2 * math.pi), rng.uniform(15e-3, 70e-3) * canvas.px_per_m
    way = np.array([math.cos(turn), math.sin(turn)])
    line = at + np.linspace(-0.5, 0.5, 30)[:, None] * length * way + np.cumsum(rng.normal(0, 0.6, (30, 2)), axis=0)
    ink = canvas.outline(line, closed=False, width=rng.uniform(1.5, 4.0))
    canvas.lay(ink.times(rng.uniform(0.5, 0.9)), (40, 42, 60))


_OBJECTS: tuple[Callable[[SceneCanvas, np.random.Generator, FloatArray], None], ...] = (
    _screw, _cable, _ruler, _label, _tape, _block, _pen, _screw, _cable,
)  # fmt: skip


def lay_objects(canvas: SceneCanvas, rng: np.random.Generator, axis_px: FloatArray) -> None:
    """Paints the scene's objects at random positions on the table.

    With ``clear_m`` above 0, an object that would be nearer than that to the axis (without its shadow) is moved.

    Args:
        canvas: canvas with the painted table.
        rng: random numbers of the objects.
        axis_px: (2, 2) base and unbent tip of the catheter, image pixels.
    """
    h, w = canvas.transmittance.shape
    clear = canvas.scene.ground.clear_m * canvas.px_per_m
    v, u = np.mgrid[0:h:4, 0:w:4]
    start, end = (np.asarray(point) * FINER for point in axis_px)
    way = end - start
    share = np.clip(((u - start[0]) * way[0] + (v - start[1]) * way[1]) / (way @ way), 0.0, 1.0)
    near = np.hypot(u - start[0] - share * way[0], v - start[1] - share * way[1]) < clear
    before = canvas.levels.copy()
    for _ in range(canvas.scene.ground.objects):
        paint = _OBJECTS[int(rng.integers(len(_OBJECTS)))]
        for _ in range(_ATTEMPTS):
            canvas.transmittance[:] = 1.0
            canvas.changed.clear()
            paint(canvas, rng, rng.uniform((0.0, 0.0), (w, h)))
            # A shadow leaves some of the light of the surface below; the object itself leaves nothing.
            done = not (canvas.transmittance[::4, ::4][near] < _COVERED).any()
            new, old = (before, canvas.levels) if done else (canvas.levels, before)
            for part in canvas.changed:
                new[part] = old[part]
            if done:
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
    v, u = np.mgrid[0:h, 0:w]
    start, end = (np.asarray(point) * FINER / _FRONT_FINER for point in axis_px)
    way = end - start
    share = np.clip(((u - start[0]) * way[0] + (v - start[1]) * way[1]) / (way @ way), 0.0, 1.0)
    near = (
        np.hypot(u - start[0] - share * way[0], v - start[1] - share * way[1]) < MIN_FRONT_DISTANCE_M * canvas.px_per_m
    )
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
    """Returns the texture of a painted board: blotches, grain, a few scratches and specks of dust."""
    h, w = canvas.transmittance.shape
    level = multi_scale_noise(rng, (h, w), (5.0, 20.0, 90.0, 350.0), 0.55) * appearance.texture_grey
    level += cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), 1.6) * (1.6 * appearance.texture_grey)
    for _ in range(int(rng.integers(2, 14))):
        start = rng.uniform((0, 0), (w, h))
        turn, length = rng.uniform(0, 2 * math.pi), rng.uniform(30, 500)
        way = np.linspace(0, length, 12)[:, None] * np.array([math.cos(turn), math.sin(turn)])
        bend = rng.uniform(-0.08, 0.08) * np.linspace(0, 1, 12)[:, None] ** 2 * length
        line = canvas.outline(start + way + bend * np.array([-math.sin(turn), math.cos(turn)]), closed=False)
        level[line.part] += line.values * rng.uniform(-1.0, 0.7) * (appearance.lines_grey * 0.5)
    for _ in range(int(rng.integers(10, 70))):
        spot = canvas.disc(rng.uniform((0, 0), (w, h)), rng.uniform(0.5, 2.2))
        level[spot.part] += spot.values * rng.uniform(-1.0, 0.4) * appearance.lines_grey
    return level


def _cloth(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture of woven cloth with soft folds; its threads are not quite straight."""
    h, w = canvas.transmittance.shape
    x, y = _grid(canvas, rng.uniform(0, math.pi))
    pitch = np.float32(2 * math.pi / rng.uniform(0.7e-3, 1.3e-3))
    waver = np.float32(1.5e-4)
    along = np.sin(pitch * (x + waver * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    across = np.sin(pitch * (y + waver * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    weave = along * across + 0.35 * (np.abs(along) - np.abs(across))
    folds = multi_scale_noise(rng, (h, w), (160.0, 420.0), 0.5)
    relief = cv2.Sobel(folds, cv2.CV_32F, 1, 1, ksize=3) * 300.0
    threads = multi_scale_noise(rng, (h, w), (3.0, 9.0, 40.0), 0.8)
    level = weave * appearance.lines_grey * 0.4 + (folds + relief + threads) * appearance.texture_grey
    return level.astype(np.float32)


def _paper(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture of millimetre paper: thin lines every mm, stronger ones every 5 and 10."""
    h, w = canvas.transmittance.shape
    level = multi_scale_noise(rng, (h, w), (4.0, 30.0, 250.0), 0.6) * (0.6 * appearance.texture_grey)
    for axis in _grid(canvas, rng.uniform(-0.08, 0.08)):
        for pitch, weight in ((1e-3, 0.25), (5e-3, 0.35), (10e-3, 0.55)):
            off = np.abs((axis / np.float32(pitch) + 0.5) % 1.0 - 0.5) * np.float32(pitch * canvas.px_per_m)
            level -= appearance.lines_grey * weight * np.exp(-((off / np.float32(0.9)) ** 2))
    return level


def _breadboard(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture of a metal table, finely brushed, with tapped holes every 25 mm."""
    h, w = canvas.transmittance.shape
    brushed = cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), sigmaX=40.0, sigmaY=0.8)
    level = brushed / brushed.std() * (0.6 * appearance.texture_grey)
    level += multi_scale_noise(rng, (h, w), (30.0, 120.0, 400.0), 0.7) * appearance.texture_grey
    turn = rng.uniform(-0.1, 0.1)
    first = rng.uniform(0, 25e-3, 2)
    x, y = _grid(canvas, turn)
    fx, fy = (
        ((axis - np.float32(f)) / np.float32(25e-3) + 0.5) % 1.0 - 0.5 for axis, f in zip((x, y), first, strict=True)
    )
    away = np.hypot(fx, fy) * np.float32(25e-3 * canvas.px_per_m)
    radius = 3.2e-3 * canvas.px_per_m
    hole = np.clip(radius + 0.5 - away, 0.0, 1.0)
    chamfer = np.exp(-(((away - 1.12 * radius) / (0.10 * radius)) ** 2)) * (0.3 + fx + fy)
    thread = 0.12 * np.sin(away * np.float32(2.4))
    dark = np.asarray(appearance.colour, np.float32).mean()
    return (level + chamfer * appearance.lines_grey * 1.5) * (1 - hole) - hole * dark * (0.72 + thread + 0.5 * fy)


def _printed(canvas: SceneCanvas, appearance: BackgroundAppearance, rng: np.random.Generator) -> FloatImage:
    """Returns the texture of a printed sheet: lines of text, bars and frames, somewhat askew."""
    h, w = canvas.transmittance.shape
    per_mm = canvas.px_per_m * 1e-3
    ink = np.zeros((h, w), np.uint8)
    letters = np.array(list("abcdefghiklmnoprstuvxyzABDEFGHKLMNPRST 0123456789  ,.-"))
    tall = rng.uniform(1.5, 4.5) * per_mm
    scale, pitch = tall / 22.0, rng.uniform(1.7, 2.6) * tall
    for v in np.arange(rng.uniform(0, pitch), 1.5 * h, pitch).astype(int).tolist():
        if rng.random() < 0.2:
            continue
        text = "".join(rng.choice(letters, max(4, int(1.2 * w / tall))))
        cv2.putText(ink, text, (int(rng.uniform(-0.3, 0.5) * w), v), cv2.FONT_HERSHEY_SIMPLEX, scale, 255,
                    max(1, round(0.1 * tall)), cv2.LINE_AA)  # fmt: skip
    for _ in range(int(rng.integers(0, 6))):
        at = rng.uniform((0, 0), (w, h))
        corner = at + rng.uniform(4, 45, 2) * per_mm
        filled = rng.random() < 0.4
        cv2.rectangle(ink, at.astype(int).tolist(), corner.astype(int).tolist(), int(rng.uniform(60, 255)),
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
    """Paints the room far behind the bench, all out of focus: edges and patches."""
    h, w = canvas.transmittance.shape
    level = np.zeros((h, w), np.float32)
    for _ in range(int(rng.integers(8, 22))):
        at, size = rng.uniform((0, 0), (w, h)), rng.uniform(0.04, 0.35, 2) * w
        turn = rng.uniform(0, math.pi)
        patch = canvas.outline(_turned(_rectangle(*size.tolist()), turn, at))
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
    pool = (u / width - light.spot_at[0]) ** 2 + ((v / height - light.spot_at[1]) * height / width) ** 2
    lit += light.spot * (np.exp(-pool / np.float32(2 * 0.35**2)) - 0.5)
    corner = 1.0 + (height / width) ** 2
    # The cosine-to-the-fourth law and the lens's barrel, as one.
    seen = (1.0 - light.vignetting * ((x**2 + y**2) / corner) ** 1.3).astype(np.float32)
    return np.maximum(light.level * lit * seen, 0.02).astype(np.float32)
