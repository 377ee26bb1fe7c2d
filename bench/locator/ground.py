"""Grounds and clutter: images of benches without a catheter, in linear light, (h, w, 3) float32 of 0..1."""

import math
from functools import cache
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]

PHOTOGRAPHS = {
    "skimage.data": "coffee.png camera.png astronaut.png gravel.png brick.png grass.png chelsea.png rocket.jpg "
    "coins.png text.png page.png motorcycle_left.png retina.jpg ihc.png",
    "sklearn.datasets.images": "china.jpg flower.jpg",
}
"""Images with a free licence from installed packages; images of packages that are not installed are left out."""


@cache
def photographs() -> tuple[npt.NDArray[np.uint8], ...]:
    """The photographs of the installed packages, RGB, at most 512 px wide."""
    found = []
    for package, names in PHOTOGRAPHS.items():
        try:
            folder = Path(next(iter(import_module(package).__path__)))
        except ModuleNotFoundError:
            continue
        for name in names.split():
            image = cv2.imread(str(folder / name)) if (folder / name).exists() else None
            if image is not None:
                scale = 512.0 / max(image.shape[:2])
                image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
                found.append(np.ascontiguousarray(image[..., ::-1]))
    return tuple(found)


@cache
def pixels(height: int, width: int) -> tuple[Float32, Float32]:
    """The rows v and the columns u of all pixels, (h, w) each; not to be changed."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    return v, u


def colour(rng: np.random.Generator, saturation: float = 1.0) -> Float32:
    """A random albedo (3,): grey in a third of the draws."""
    grey = rng.uniform(0.02, 0.95) ** 1.3
    if rng.random() < 0.35:
        return np.full(3, grey, np.float32)
    tint = rng.uniform(0.0, 1.0, 3)
    tint /= max(tint.max(), 1e-3)
    strength = saturation * rng.uniform(0.1, 1.0)
    return (grey * (1.0 - strength + strength * tint)).astype(np.float32)


def clouds(rng: np.random.Generator, height: int, width: int, coarse: int, octaves: int = 3) -> Float32:
    """Smooth noise (h, w) with unit standard deviation; ``coarse``: number of cells of the first octave."""
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        cells = min(coarse * 2**octave, width)
        small = rng.normal(size=(max(2, round(cells * height / width)) + 2, cells + 2)).astype(np.float32)
        total += cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC) * 0.55**octave
    return total / max(float(total.std()), 1e-6)


def ground(rng: np.random.Generator, height: int, width: int) -> Float32:
    """A random ground (h, w, 3)."""
    base = colour(rng)
    light = np.empty((height, width, 3), np.float32)
    light[:] = base
    kind = rng.choice(8, p=[0.2, 0.16, 0.12, 0.1, 0.1, 0.12, 0.1, 0.1])
    v, u = pixels(height, width)
    turn = rng.uniform(0.0, math.pi)
    along, across = u * math.cos(turn) + v * math.sin(turn), -u * math.sin(turn) + v * math.cos(turn)
    if kind == 1:  # a box or a corner: planes that meet in seams
        for _ in range(int(rng.integers(1, 4))):
            a = rng.uniform(0.0, 2.0 * math.pi)
            edge = (u - rng.uniform(0, width)) * math.cos(a) + (v - rng.uniform(0, height)) * math.sin(a)
            light = np.where((edge > 0.0)[..., None], light * np.float32(rng.uniform(0.55, 1.4)), light)
            if rng.random() < 0.6:
                seam = np.exp(-((edge / rng.uniform(0.7, 2.5)) ** 2))[..., None]
                light = light * (1.0 - rng.uniform(0.2, 0.8) * seam)
            if rng.random() < 0.2:
                light = np.where((np.abs(edge) < rng.uniform(2.0, 9.0))[..., None], colour(rng), light)
    elif kind == 2:  # stains, paper, felt
        strength = rng.uniform(0.03, 0.25)
        light *= np.exp(strength * clouds(rng, height, width, int(rng.integers(3, 40))))[..., None]
    elif kind == 3:  # cloth or mesh
        period = rng.uniform(3.0, 14.0)
        weave = np.sin(6.2832 * along / period) * np.sin(6.2832 * across / (period * rng.uniform(0.6, 1.6)))
        light *= (1.0 + rng.uniform(0.03, 0.3) * weave)[..., None].astype(np.float32)
    elif kind == 4:  # brushed metal or wood
        small = rng.normal(size=(height // 2 + 2, max(3, width // int(rng.integers(12, 60))))).astype(np.float32)
        streaks = cv2.resize(small, (int(1.5 * width), int(1.5 * height)), interpolation=cv2.INTER_LINEAR)
        matrix = cv2.getRotationMatrix2D((0.75 * width, 0.75 * height), math.degrees(turn), 1.0)
        matrix[:, 2] -= (0.25 * width, 0.25 * height)
        streaks = cv2.warpAffine(streaks, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)
        light *= np.exp(rng.uniform(0.03, 0.25) * streaks)[..., None]
    elif kind == 5:  # printed grid, graph paper, ruler
        period, thick, ink = rng.uniform(6.0, 50.0), rng.uniform(0.5, 2.0), colour(rng)
        lines = np.abs((along / period) % 1.0 - 0.5) * period < thick
        if rng.random() < 0.7:
            lines |= np.abs((across / period) % 1.0 - 0.5) * period < thick
        else:
            lines &= np.abs(across - rng.uniform(-0.5, 1.0) * height) < rng.uniform(6.0, 24.0)
        light = np.where(lines[..., None], ink, light)
    elif kind == 6:  # checks
        period = rng.uniform(10.0, 60.0)
        checks = (np.floor(along / period) + np.floor(across / period)) % 2 > 0
        light = np.where(checks[..., None], colour(rng), light)
    elif kind == 7 and photographs():
        photo = photographs()[rng.integers(len(photographs()))]
        scale = rng.uniform(1.0, 2.6) * max(height / photo.shape[0], width / photo.shape[1])
        big = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        top, left = rng.integers(0, big.shape[0] - height + 1), rng.integers(0, big.shape[1] - width + 1)
        crop = big[top : top + height, left : left + width, :: rng.choice([-1, 1])].astype(np.float32) / 255.0
        if rng.random() < 0.5:
            crop = cv2.GaussianBlur(crop, (0, 0), rng.uniform(0.8, 5.0))
        light = crop**2.2 * np.exp(rng.normal(0.0, 0.3))
    light = np.ascontiguousarray(light, np.float32)
    if rng.random() < 0.5:
        _clutter(rng, light)
    return light


def _clutter(rng: np.random.Generator, light: Float32) -> None:
    """Draws boxes, discs, slots, screws and patches on the ground, in place."""
    height, width = light.shape[:2]
    for _ in range(int(rng.integers(1, 7))):
        size = rng.uniform(0.03, 0.35) * width
        middle = rng.uniform((-0.1 * width, -0.1 * height), (1.1 * width, 1.1 * height))
        tone = tuple(float(x) for x in colour(rng))
        if rng.random() < 0.35:
            cv2.circle(light, (int(middle[0]), int(middle[1])), max(2, int(0.4 * size)), tone, -1, cv2.LINE_AA)
            if rng.random() < 0.5:
                ring = tuple(float(x) for x in colour(rng))
                cv2.circle(light, (int(middle[0]), int(middle[1])), max(2, int(0.4 * size)), ring, 2, cv2.LINE_AA)
        else:
            sides = (size, size * rng.uniform(0.06, 1.0))
            corners = cv2.boxPoints((tuple(middle.tolist()), sides, float(rng.uniform(0.0, 180.0))))
            cv2.fillPoly(light, [np.round(corners * 16).astype(np.int32)], tone, cv2.LINE_AA, 4)
            if rng.random() < 0.3:
                edge = tuple(float(x) for x in colour(rng))
                cv2.polylines(light, [np.round(corners * 16).astype(np.int32)], True, edge, 1, cv2.LINE_AA, 4)


def uneven_light(rng: np.random.Generator, height: int, width: int) -> Float32:
    """Returns the light over the bench (h, w), mean about 1: a gradient, spots, shadows of outside objects."""
    v, u = (values / max(height, width) - 0.5 for values in pixels(height, width))
    turn, slope = rng.uniform(0.0, 2.0 * math.pi), abs(rng.normal(0.0, 0.5))
    field = 1.0 + slope * (u * math.cos(turn) + v * math.sin(turn))
    if rng.random() < 0.3:
        spot = rng.uniform(-0.6, 0.6, 2)
        field += rng.uniform(0.2, 1.5) * np.exp(-((u - spot[0]) ** 2 + (v - spot[1]) ** 2) / rng.uniform(0.1, 0.5) ** 2)
    if rng.random() < 0.3:
        edge = (u - rng.uniform(-0.5, 0.5)) * math.sin(turn) + (v - rng.uniform(-0.5, 0.5)) * math.cos(turn)
        field *= 1.0 - rng.uniform(0.1, 0.6) / (1.0 + np.exp(np.clip(-edge / rng.uniform(0.005, 0.1), -30.0, 30.0)))
    if rng.random() < 0.3:
        field *= 1.0 - rng.uniform(0.2, 1.2) * (u * u + v * v)
    return np.maximum(field, 0.05).astype(np.float32)
