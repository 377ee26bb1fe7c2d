"""The table that the catheter hangs over: its material, then what lies on it."""

import math

import cv2
import numpy as np

from ....types import FloatArray
from ._canvas import Canvas, multi_scale_noise
from ._objects import lay_objects
from ._patch import Picture
from ._scene import CameraScene, GroundLook

__all__ = ["GROUNDS", "illumination", "paint_ground"]


def _grid(canvas: Canvas, turn: float) -> tuple[Picture, Picture]:
    """Coordinates of the canvas's pixels in metres along axes turned by ``turn``."""
    h, w = canvas.left.shape
    v, u = np.mgrid[0:h, 0:w].astype(np.float32) / np.float32(canvas.px_per_m)
    c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
    return c * u + s * v, c * v - s * u


def _board(canvas: Canvas, look: GroundLook, rng: np.random.Generator) -> Picture:
    """Painted board: blotches, grain, a few scratches and specks of dust."""
    h, w = canvas.left.shape
    level = multi_scale_noise(rng, (h, w), (5.0, 20.0, 90.0, 350.0), 0.55) * look.texture_grey
    level += cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), 1.6) * (1.6 * look.texture_grey)
    for _ in range(int(rng.integers(2, 14))):
        start = rng.uniform((0, 0), (w, h))
        turn, length = rng.uniform(0, 2 * math.pi), rng.uniform(30, 500)
        way = np.linspace(0, length, 12)[:, None] * np.array([math.cos(turn), math.sin(turn)])
        bend = rng.uniform(-0.08, 0.08) * np.linspace(0, 1, 12)[:, None] ** 2 * length
        line = canvas.outline(start + way + bend * np.array([-math.sin(turn), math.cos(turn)]), closed=False)
        level[line.part] += line.values * rng.uniform(-1.0, 0.7) * (look.lines_grey * 0.5)
    for _ in range(int(rng.integers(10, 70))):
        spot = canvas.disc(rng.uniform((0, 0), (w, h)), rng.uniform(0.5, 2.2))
        level[spot.part] += spot.values * rng.uniform(-1.0, 0.4) * look.lines_grey
    return level


def _cloth(canvas: Canvas, look: GroundLook, rng: np.random.Generator) -> Picture:
    """Woven cloth with soft folds: threads go over and under one another, and are not quite straight."""
    h, w = canvas.left.shape
    x, y = _grid(canvas, rng.uniform(0, math.pi))
    pitch = np.float32(2 * math.pi / rng.uniform(0.7e-3, 1.3e-3))
    waver = np.float32(1.5e-4)
    along = np.sin(pitch * (x + waver * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    across = np.sin(pitch * (y + waver * multi_scale_noise(rng, (h, w), (60.0, 150.0))))
    weave = along * across + 0.35 * (np.abs(along) - np.abs(across))
    folds = multi_scale_noise(rng, (h, w), (160.0, 420.0), 0.5)
    relief = cv2.Sobel(folds, cv2.CV_32F, 1, 1, ksize=3) * 300.0
    threads = multi_scale_noise(rng, (h, w), (3.0, 9.0, 40.0), 0.8)
    level = weave * look.lines_grey * 0.4 + (folds + relief + threads) * look.texture_grey
    return level.astype(np.float32)


def _paper(canvas: Canvas, look: GroundLook, rng: np.random.Generator) -> Picture:
    """Millimetre paper: thin lines every mm, stronger ones every 5 and 10."""
    h, w = canvas.left.shape
    level = multi_scale_noise(rng, (h, w), (4.0, 30.0, 250.0), 0.6) * (0.6 * look.texture_grey)
    for axis in _grid(canvas, rng.uniform(-0.08, 0.08)):
        for pitch, weight in ((1e-3, 0.25), (5e-3, 0.35), (10e-3, 0.55)):
            off = np.abs((axis / np.float32(pitch) + 0.5) % 1.0 - 0.5) * np.float32(pitch * canvas.px_per_m)
            level -= look.lines_grey * weight * np.exp(-((off / np.float32(0.9)) ** 2))
    return level


def _breadboard(canvas: Canvas, look: GroundLook, rng: np.random.Generator) -> Picture:
    """Metal table, finely brushed, with tapped holes every 25 mm."""
    h, w = canvas.left.shape
    brushed = cv2.GaussianBlur(rng.standard_normal((h, w), np.float32), (0, 0), sigmaX=40.0, sigmaY=0.8)
    level = brushed / brushed.std() * (0.6 * look.texture_grey)
    level += multi_scale_noise(rng, (h, w), (30.0, 120.0, 400.0), 0.7) * look.texture_grey
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
    dark = np.asarray(look.colour, np.float32).mean()
    return (level + chamfer * look.lines_grey * 1.5) * (1 - hole) - hole * dark * (0.72 + thread + 0.5 * fy)


GROUNDS = {"board": _board, "cloth": _cloth, "paper": _paper, "breadboard": _breadboard}


def paint_ground(scene: CameraScene, width: int, height: int, px_per_m: float, axis_px: FloatArray) -> Canvas:
    """The table at light 1. ``axis_px`` (2, 2): base and where an unbent tip would be, pictures' pixels."""
    rng = np.random.default_rng([scene.seed, 1])
    canvas = Canvas.empty(width, height, px_per_m, scene)
    texture = GROUNDS[scene.ground.kind](canvas, scene.ground, rng)
    colour = np.asarray(scene.ground.colour, np.float32)
    # Unevenness of the surface is unevenness of the light it sends back: it keeps the surface's own colour.
    canvas.levels[:] = colour * (1.0 + texture[..., None] / np.float32(max(colour.mean(), 1.0)))
    np.maximum(canvas.levels, 0.0, out=canvas.levels)
    canvas.left[:] = 0.0
    lay_objects(canvas, rng, axis_px)
    return canvas


def illumination(scene: CameraScene, width: int, height: int) -> Picture:
    """(h, w): how bright each place of the picture is lit and seen; 1 is the middle of an even light of level 1."""
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
