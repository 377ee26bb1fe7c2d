"""``python -m bench.rendering``: frames a second of the simulated camera, beside the plain NumPy and OpenCV way.

Both draw one session of a preset in the same run: a beating wall, a moving catheter, motion blur, noise. The plain way
has its still ground for nothing too; it draws the catheter as thick lines at four times the size, moves the phantom by
warping, blurs the image, and takes its noise from NumPy's generators. "written": with JPEG and truth, on disk.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from bench.parts import run_alone
from bench.timing import interleaved
from bench.written import Packed, pack, write

from tipforce.simulation.rendering.camera import (
    BENCH_2021,
    GENERALISE,
    CameraRenderer,
    TissueHome,
    TissueState,
    sample_scene,
)

LENGTH_M = 0.048
FRAMES = 48
"""Number of frames of a block."""
SIZES = ((320, 240), (640, 480), (1280, 960), (1920, 1440))
LONGER = (24, 96, 384)
"""Number of frames of one run, at 640x480."""


class Session:
    """Shapes and tissue of some seconds at 24 frames a second: 1.2 Hz, 4 mm into the wall and 2 mm along it."""

    def __init__(self, preset, seed: int, size: tuple[int, int]) -> None:
        rng = np.random.default_rng([seed, 7])
        scene = sample_scene(preset, rng, length_m=LENGTH_M)
        into = np.array([math.cos(0.5), math.sin(0.5), 0.0])
        self.rest = self.shape(0.3)
        home = TissueHome(self.rest[-1] - 1e-3 * into, into)
        self.width, self.height = size
        self.renderer = CameraRenderer(scene, LENGTH_M, tissue=home, width=size[0], height=size[1])
        self.jobs = []
        for k in range(FRAMES):
            at = k / 24 + np.linspace(-0.5, 0.5, 5) * scene.exposure_s
            push = np.sin(2 * math.pi * 1.2 * at)
            along = 0.5 * np.sin(2 * math.pi * 1.2 * at + 1.0)
            shapes = np.stack([self.shape(0.3 - 0.12 * p) for p in push])
            shift = 4e-3 * (push[:, None] * into + along[:, None] * [-into[1], into[0], 0.0])
            self.jobs.append((shapes, TissueState(shift, 1e-3, shapes[2, -1]), k))

    @staticmethod
    def shape(turning: float) -> np.ndarray:
        s = np.linspace(0.0, LENGTH_M, 61)
        radius = LENGTH_M / turning
        return np.stack([radius * np.sin(s / radius), radius * (1 - np.cos(s / radius)), 0 * s], axis=1)

    def ours(self, job) -> np.ndarray:
        return self.renderer.render(job[0], job[1], frame=job[2], time_s=job[2] / 24)

    def whole(self, job) -> Packed:
        truth = self.renderer.truth(job[0], job[1], time_s=job[2] / 24)
        return pack(self.ours(job), truth, self.renderer.scene.jpeg_quality)

    def plain_parts(self) -> None:
        """Prepares the plain way: a still ground, and the phantom cut out of an image with it."""
        away = self.rest[None] + np.array([0.0, 0.25, 0.0])
        self.ground = self.renderer.clean(away)
        with_it = self.renderer.clean(away, TissueState(np.zeros((1, 3))))
        self.alpha = (np.abs(with_it - self.ground).max(axis=2) > 4).astype(np.float32)
        self.phantom = with_it
        self.rng = np.random.default_rng(0)

    def plain(self, job) -> np.ndarray:
        scene, camera = self.renderer.scene, self.renderer.camera
        shapes, tissue, _ = job
        width = round(8 * scene.catheter.radius_m / scene.lens.scale_m_per_px * self.width / 640)
        total = np.zeros_like(self.ground)
        home = camera.project(self.rest[-1:])
        for shape, shift in zip(shapes, tissue.shift_m, strict=True):
            image = self.ground.copy()
            du, dv = (camera.project(self.rest[-1:] + shift) - home)[0]
            way = np.array([[1, 0, du], [0, 1, dv]], np.float32)
            alpha = cv2.warpAffine(self.alpha, way, (self.width, self.height))[..., None]
            image += alpha * (cv2.warpAffine(self.phantom, way, (self.width, self.height)) - image)
            mask = np.zeros((4 * self.height, 4 * self.width), np.uint8)
            line = np.round((4 * camera.project(shape) + 1.5) * 16).astype(np.int32)
            cv2.polylines(mask, [line], False, 255, width, cv2.LINE_AA, 4)
            cover = cv2.resize(mask, (self.width, self.height), interpolation=cv2.INTER_AREA)[..., None] / np.float32(
                255
            )
            shadow = cv2.GaussianBlur(np.roll(cover[..., 0], (10, 10), (0, 1)), (0, 0), 4.0)[..., None]
            image *= 1 - 0.3 * shadow
            image += cover * (np.array(scene.catheter.finish.shaft, np.float32) - image)
            total += image
        total = cv2.GaussianBlur(total / len(shapes), (0, 0), scene.lens.blur_px)
        noise = scene.noise
        shot = self.rng.poisson(np.maximum(total, 0) / noise.grey_per_electron) * noise.grey_per_electron
        return np.clip(np.rint(shot + self.rng.normal(0, noise.read_grey, total.shape)), 0, 255).astype(np.uint8)


def of_preset(preset, size: tuple[int, int], plainly: bool, blocks: int = 4) -> dict[str, float]:
    """Returns frames a second of the best block, by way."""
    session = Session(preset, 4, size)
    jobs = session.jobs
    with ThreadPoolExecutor(2) as pool:
        ways = {
            "rendered, 1 thread": lambda: [session.ours(job) for job in jobs],
            "rendered, 2 threads": lambda: list(pool.map(session.ours, jobs)),
            "written, 2 threads": lambda: write(pool.map(session.whole, jobs)),
        }
        frames = dict.fromkeys(ways, len(jobs))
        if plainly:
            session.plain_parts()
            ways["plain, 1 thread"] = lambda: [session.plain(job) for job in jobs[:4]]
            frames["plain, 1 thread"] = 4
        return {name: frames[name] / t for name, t in interleaved(ways, blocks).items()}


def by_length(blocks: int = 2) -> dict[str, float]:
    """Returns frames a second, written by two threads, for runs of different lengths."""
    session = Session(BENCH_2021, 4, (640, 480))
    with ThreadPoolExecutor(2) as pool:

        def work(count: int):
            jobs = [session.jobs[k % FRAMES] for k in range(count)]
            return lambda: write(pool.map(session.whole, jobs))

        times = interleaved({str(count): work(count) for count in LONGER}, blocks)
    return {count: int(count) / t for count, t in times.items()}


def measure() -> dict[str, Any]:
    cv2.setNumThreads(1)
    figures: dict[str, Any] = {f"bench-2021 {w}x{h}": of_preset(BENCH_2021, (w, h), plainly=w == 640) for w, h in SIZES}
    figures["generalise 640x480"] = of_preset(GENERALISE, (640, 480), plainly=False)
    figures["by length"] = by_length()
    return figures


def show(figures: dict[str, Any]) -> None:
    print("camera, frames a second:")
    for name, row in figures.items():
        if name != "by length":
            print(f"  {name:22} " + ", ".join(f"{way} {rate:.1f}" for way, rate in row.items()))
    row = figures["bench-2021 640x480"]
    print(f"  rendered on one thread: {row['rendered, 1 thread'] / row['plain, 1 thread']:.0f} x the plain way")
    pixels = [w * h for w, h in SIZES]
    cost = [
        1e9 / figures[f"bench-2021 {w}x{h}"]["rendered, 1 thread"] / n for (w, h), n in zip(SIZES, pixels, strict=True)
    ]
    print("  rendering, ns a pixel by size: " + ", ".join(f"{c:.1f}" for c in cost))
    print("  written, by frames in one go: " + ", ".join(f"{n}: {r:.0f}" for n, r in figures["by length"].items()))


if __name__ == "__main__":
    run_alone("camera", measure, show, __doc__)
