"""``python -m tipforce.pipelines._precompile``: compiles the hot loops right after an installation.

numba compiles a function when it is first called, and keeps the result beside the source. Here each job is done once on
a few small images, so that the first command of a user finds everything compiled.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed

import cv2
import numpy as np
import numpy.typing as npt

from .._system.cores import cores
from .._system.processes import worker_pool
from ..types import ActuationInfo, Catheter, SensorInfo, SessionInfo, ViewInfo
from ._simulate import preset_settings

_INFO = SessionInfo(
    "installation",
    Catheter("installation", 2.3e-3, 40e-3, 8e-3, bending_stiffness_nm2=4.5e-4),
    {"camera": ViewInfo(3e-4, "left")},
    SensorInfo(0.0, "tissue-on-tip"),
    ActuationInfo(0.5),
)


def _images(count: int = 12) -> Iterator[npt.NDArray[np.uint8]]:
    """Yields (240, 320) images of a dark tube that bends more and more."""
    for number in range(count):
        x = np.arange(-10.0, 151.0)
        points = np.stack([x, 120.0 - (20.0 + 3.0 * number) * (x / 160.0) ** 2], axis=1)
        image = np.full((240, 320, 3), 210, np.uint8)
        cv2.polylines(image, [np.rint(points * 16).astype(np.int32)], False, (40, 40, 40), 8, cv2.LINE_AA, 4)
        yield image


def _detect() -> None:
    from . import estimate

    for model in ("pretrained/compact", "pretrained/dcfe", "fusion", "rod-3d", "links", "elastica", "pseudo-rigid"):
        for _ in estimate(model, _images(), bench=_INFO, actuation={"knob_deg": 10.0}):
            pass


def _simulate(preset: str) -> None:
    from . import simulate

    settings = preset_settings(preset, changes={"width": 160, "height": 160, "world": {"seconds": 8.0}})
    with tempfile.TemporaryDirectory() as folder:
        simulate(folder, settings, sessions=1, form="files")


def _simulate_camera() -> None:
    _simulate("bench-2021")
    _simulate("varied")


def _simulate_fluoroscope() -> None:
    _simulate("fluoro")


def _triangulate() -> None:
    from ..geometry import CArm, triangulate

    cameras = [CArm(angle, 0.0, 1.1, 0.75, 0.25e-3).camera() for angle in (0.0, 90.0)]
    points = np.linspace(-0.01, 0.01, 6).reshape(2, 3)
    triangulate(cameras, np.stack([camera.project(points) for camera in cameras], axis=1))


_JOBS: dict[str, Callable[[], None]] = {
    "simulation of a camera": _simulate_camera,
    "detection of the catheter and the rod model": _detect,
    "simulation of a fluoroscope": _simulate_fluoroscope,
    "points from two views": _triangulate,
}


def main() -> None:
    """Does all jobs, side by side on the cores of this machine, and prints each that has ended."""
    started = time.monotonic()
    with worker_pool(min(cores(), len(_JOBS))) as pool:
        running = {pool.submit(job): name for name, job in _JOBS.items()}
        for done in as_completed(running):
            done.result()
            sys.stdout.write(f"  {running[done]}: compiled after {time.monotonic() - started:.0f} s\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
