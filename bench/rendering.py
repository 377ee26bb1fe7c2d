"""Frames a second of the twin's camera, beside the plain NumPy and OpenCV way of the same picture, in the same run.

    OMP_NUM_THREADS=1 python bench/rendering.py [--frames N] [--json FILE]

Both draw one session of each preset: a beating wall, a moving catheter, motion blur, noise. The plain way has its still
ground for nothing too; it draws the catheter as thick lines at four times the size, moves the phantom by warping,
blurs the picture, and takes its noise from NumPy's generators. Ways are timed in turn, each figure is of the best
block; milliseconds of processor time tell what a busy machine hides.
"""

import argparse
import json
import math
import pathlib
import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from tipforce.twin.camera import BENCH_2021, GENERALISE, CameraRenderer, TissueHome, TissueState, draw_scene

LENGTH_M = 0.048
FRAMES = 96


class Session:
    """Shapes and tissue of some seconds at 24 frames a second: 1.2 Hz, 4 mm into the wall and 2 mm along it."""

    def __init__(self, preset, seed: int, size: tuple[int, int]) -> None:
        rng = np.random.default_rng([seed, 7])
        scene = draw_scene(preset, rng, length_m=LENGTH_M)
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

    def all_of_it(self, job) -> int:
        picture = self.ours(job)
        truth = self.renderer.truth(job[0], job[1], time_s=job[2] / 24)
        quality = [cv2.IMWRITE_JPEG_QUALITY, self.renderer.scene.jpeg_quality]
        data = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), quality)[1]
        return data.size + int(truth.visible.sum())

    def plain_parts(self) -> None:
        """What the plain way may prepare: a still ground, and the phantom cut out of a picture with it."""
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
            picture = self.ground.copy()
            du, dv = (camera.project(self.rest[-1:] + shift) - home)[0]
            way = np.array([[1, 0, du], [0, 1, dv]], np.float32)
            alpha = cv2.warpAffine(self.alpha, way, (self.width, self.height))[..., None]
            picture += alpha * (cv2.warpAffine(self.phantom, way, (self.width, self.height)) - picture)
            mask = np.zeros((4 * self.height, 4 * self.width), np.uint8)
            line = np.round((4 * camera.project(shape) + 1.5) * 16).astype(np.int32)
            cv2.polylines(mask, [line], False, 255, width, cv2.LINE_AA, 4)
            cover = cv2.resize(mask, (self.width, self.height), interpolation=cv2.INTER_AREA)[..., None] / np.float32(
                255
            )
            shadow = cv2.GaussianBlur(np.roll(cover[..., 0], (10, 10), (0, 1)), (0, 0), 4.0)[..., None]
            picture *= 1 - 0.3 * shadow
            picture += cover * (np.array(scene.catheter.finish.shaft, np.float32) - picture)
            total += picture
        total = cv2.GaussianBlur(total / len(shapes), (0, 0), scene.lens.blur_px)
        noise = scene.noise
        shot = self.rng.poisson(np.maximum(total, 0) / noise.grey_per_electron) * noise.grey_per_electron
        return np.clip(np.rint(shot + self.rng.normal(0, noise.read_grey, total.shape)), 0, 255).astype(np.uint8)


def best(work, jobs, blocks: int) -> dict[str, float]:
    """Frames a second and processor time a frame of the fastest of ``blocks`` equal parts of ``jobs``."""
    size = len(jobs) // blocks
    rates, costs = [], []
    for k in range(blocks):
        begin, spent = time.perf_counter(), time.process_time()
        work(jobs[k * size : (k + 1) * size])
        rates.append(size / (time.perf_counter() - begin))
        costs.append((time.process_time() - spent) / size * 1e3)
    return {"frames_per_s": max(rates), "cpu_ms": min(costs)}


def measure(preset, size: tuple[int, int], frames: int) -> dict[str, dict[str, float]]:
    session = Session(preset, 4, size)
    jobs = [session.jobs[k % FRAMES] for k in range(frames)]
    session.plain_parts()
    session.all_of_it(jobs[0])
    session.plain(jobs[0])
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(session.all_of_it, jobs[:4]))
        return {
            "render_1_thread": best(lambda part: [session.ours(job) for job in part], jobs, 6),
            "plain_1_thread": best(lambda part: [session.plain(job) for job in part], jobs[:12], 3),
            "render_2_threads": best(lambda part: list(pool.map(session.ours, part)), jobs, 6),
            "render_truth_jpeg_2_threads": best(lambda part: list(pool.map(session.all_of_it, part)), jobs, 6),
            "render_1_thread_again": best(lambda part: [session.ours(job) for job in part], jobs, 6),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    results = {}
    for name, preset in (("bench-2021", BENCH_2021), ("generalise", GENERALISE)):
        for size in ((320, 240), (640, 480), (1280, 960)) if name == "bench-2021" else ((640, 480),):
            figures = results[f"{name} {size[0]}x{size[1]}"] = measure(preset, size, given.frames)
            print(f"{name} {size[0]}x{size[1]}, frames a second, processor time a frame (best block)")
            for key, row in figures.items():
                print(f"  {key.replace('_', ' '):30} {row['frames_per_s']:8.1f} {row['cpu_ms']:9.2f} ms")
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
