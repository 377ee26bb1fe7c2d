"""``python -m bench.rendering_fluoroscope``: frames a second, beside plain NumPy and SciPy.

Both draw the same session: one catheter that moves during the pulse, the session's other instruments, anatomy that
beats and breathes, scatter, glare, Poisson noise, lag, blur, electronic noise, display curve. "written": with JPEG and
truth, on disk.
"""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, pairwise
from typing import Any

import cv2
import numpy as np
from bench.parts import run_alone
from bench.timing import interleaved
from bench.written import Packed, pack, write
from scipy.ndimage import gaussian_filter, shift, zoom

from tipforce.simulation.rendering.fluoroscope import FLUORO, Pulse, XrayRenderer, sample_xray_scene
from tipforce.simulation.rendering.fluoroscope._instruments import swayed
from tipforce.simulation.rendering.fluoroscope._scene import lag_weights
from tipforce.simulation.rendering.fluoroscope._static_layers import COARSE
from tipforce.simulation.rendering.fluoroscope._tube_model import Tube

LENGTH_M = 55e-3


def pulses(count: int, first: int = 0) -> list[Pulse]:
    """A bent catheter whose tip moves by up to 10 cm/s."""
    s = np.linspace(0.0, LENGTH_M, 61)
    found = []
    for k in range(first, first + count):
        ends = []
        for t in (k / 15.0, k / 15.0 + 7e-3):
            bend = 18.0 + 6.0 * math.sin(2 * math.pi * 1.2 * t)
            ends.append(np.stack([np.sin(bend * s) / bend, (1 - np.cos(bend * s)) / bend, 3.0 * s**2], axis=1))
        found.append(Pulse(np.stack(ends), None, k, k / 15.0))
    return found


class Plain:
    """The same image by NumPy and SciPy alone; tubes as distances from every pixel near them to their chords."""

    def __init__(self, renderer: XrayRenderer) -> None:
        self.renderer, self.layers = renderer, renderer._layers
        self.plane = renderer.scene.views[0]
        self.rng = np.random.default_rng(0)
        self.past: list[np.ndarray] = []

    def frame(self, pulse: Pulse) -> np.ndarray:
        layers, detector, scene = self.layers, self.plane.detector, self.renderer.scene
        h, w = layers.still.shape
        rhythm = scene.rhythm
        breath = -rhythm.breath_m * rhythm.breath(pulse.time_s) * layers.head_px
        m, coarse = layers.margin, layers.coarse_margin
        chest = shift(layers.chest, 0.15 * breath[::-1], order=1)[m : m + h, m : m + w]
        soft = sum(
            zoom(shift(layer, by[::-1] / COARSE, order=1)[coarse:-coarse, coarse:-coarse], COARSE, order=1)
            for layer, by in ((layers.heart, 0.3 * breath), (layers.liver, breath))
        )
        through = np.zeros((h, w))
        for part in np.linspace(0.0, 1.0, 3):
            tubes = np.zeros((h, w))
            points = (1 - part) * pulse.shapes_m[0] + part * pulse.shapes_m[1]
            lay(tubes, layers.camera.project(points), layers.catheter)
            for item in layers.devices:
                at = swayed(item.instrument, item.points_m, item.share, rhythm, pulse.time_s)
                lay(tubes, layers.patient_camera.project(at), item.tube)
            through += np.exp(-tubes) / 3
        light = np.exp(-(layers.still + chest + soft)) * through
        scattered = detector.scatter * gaussian_filter(light, detector.scatter_m * layers.px_per_m, mode="nearest")
        light = light + scattered
        spread = gaussian_filter(light, detector.glare_m * layers.px_per_m, mode="nearest")
        light = (1 - detector.glare) * light + detector.glare * spread
        counts = self.rng.poisson(light * self.plane.beam.photons / light.mean()).astype(np.float64)
        weights = lag_weights(detector)
        self.past = [counts, *self.past][: len(weights)]
        signal = sum(w * q for w, q in zip(weights, self.past, strict=False))
        core, tail = (gaussian_filter(signal, sigma) for sigma in detector.blur_px)
        signal = (1 - detector.blur_tail) * core + detector.blur_tail * tail
        signal = (
            signal + self.rng.normal(0, detector.electronic, (h, w)) + self.rng.normal(0, detector.line_noise, (h, 1))
        )
        grey = 128 + detector.contrast * np.log(np.maximum(signal, 0.01) / self.plane.beam.photons)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def lay(tubes: np.ndarray, pixels: np.ndarray, tube: Tube) -> None:
    """Add a tube of one material along ``pixels`` (n, 2): for each pixel in its box, the nearest chord."""
    h, w = tubes.shape
    reach = tube.section_profiles.reach_px
    (u0, v0), (u1, v1) = np.floor(pixels.min(axis=0) - reach), np.ceil(pixels.max(axis=0) + reach)
    u0, v0, u1, v1 = max(0, int(u0)), max(0, int(v0)), min(w, int(u1)), min(h, int(v1))
    if u1 <= u0 or v1 <= v0:
        return
    v, u = np.mgrid[v0:v1, u0:u1].astype(np.float64)
    nearest = np.full(v.shape, np.inf)
    for a, b in pairwise(pixels):
        way = b - a
        t = np.clip(((u - a[0]) * way[0] + (v - a[1]) * way[1]) / max(way @ way, 1e-12), 0.0, 1.0)
        np.minimum(nearest, np.hypot(u - a[0] - t * way[0], v - a[1] - t * way[1]), out=nearest)
    table = tube.section_profiles.table[0]
    tubes[v0:v1, u0:u1] += np.interp(nearest, np.arange(table.size) / 16.0, table, right=0.0)


def of_size(size: int, plainly: bool, blocks: int = 4, frames: int = 24) -> dict[str, float]:
    """Frames a second of the best block, by way."""
    scene = sample_xray_scene(FLUORO, np.random.default_rng(6))
    renderer = XrayRenderer(scene, LENGTH_M, width=size, height=size)
    run = pulses(frames)

    def drawn(part: list[Pulse]) -> int:
        return sum(1 for _ in renderer.run(part))

    def whole(part: list[Pulse]) -> list[Packed]:
        shown = zip(part, renderer.run(part), strict=True)
        return [pack(image, renderer.truth(pulse.shapes_m), 90) for pulse, image in shown]

    parts = [run[: frames // 2], run[frames // 2 :]]
    with ThreadPoolExecutor(2) as pool:

        def both() -> Iterator[Packed]:
            return chain.from_iterable(pool.map(whole, parts))

        ways = {
            "rendered, 1 thread": lambda: drawn(run),
            "rendered, 2 threads": lambda: list(pool.map(drawn, parts)),
            "written, 2 threads": lambda: write(both()),
        }
        counts = dict.fromkeys(ways, frames)
        if plainly:
            plain = Plain(renderer)
            ways["plain, 1 thread"] = lambda: plain.frame(run[0])
            counts["plain, 1 thread"] = 1
        return {name: counts[name] / t for name, t in interleaved(ways, blocks).items()}


SIZES = (256, 512, 1024)


def measure() -> dict[str, Any]:
    cv2.setNumThreads(1)
    return {f"{size}x{size}": of_size(size, plainly=size == 512) for size in SIZES}


def show(figures: dict[str, Any]) -> None:
    print("fluoroscope, frames a second:")
    for name, row in figures.items():
        print(f"  {name:10} " + ", ".join(f"{way} {rate:.1f}" for way, rate in row.items()))
    row = figures["512x512"]
    print(f"  rendered on one thread: {row['rendered, 1 thread'] / row['plain, 1 thread']:.0f} x the plain way")
    cost = [1e9 / figures[f"{n}x{n}"]["rendered, 1 thread"] / n**2 for n in SIZES]
    print("  rendering, ns a pixel by size: " + ", ".join(f"{c:.1f}" for c in cost))


if __name__ == "__main__":
    run_alone("fluoroscope", measure, show, __doc__)
