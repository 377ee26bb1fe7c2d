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
from ..estimators.session import Knowledge, LineFrame, RodTrackSettings, SessionFilter, rod_model
from ..types import ActuationInfo, Catheter, CentrelinePx, FloatArray, SensorInfo, SessionInfo, ViewInfo
from ..vision import SessionDetector, VisionSettings
from ._simulate import preset_settings

_INFO = SessionInfo(
    "installation",
    Catheter("installation", 2.3e-3, 40e-3, 8e-3, bending_stiffness_nm2=4.5e-4),
    {"camera": ViewInfo(3e-4, "left")},
    SensorInfo(0.0, "tissue-on-tip"),
    ActuationInfo(0.5),
)


def _axes(count: int = 12) -> Iterator[FloatArray]:
    """Yields axes (161, 2) px of a tube that bends more and more, from the left border of an image on."""
    for number in range(count):
        x = np.arange(-10.0, 151.0)
        yield np.stack([x, 120.0 - (20.0 + 3.0 * number) * (x / 160.0) ** 2], axis=1)


def _images() -> Iterator[npt.NDArray[np.uint8]]:
    """Yields (240, 320, 3) images of this tube."""
    for axis in _axes():
        image = np.full((240, 320, 3), 210, np.uint8)
        cv2.polylines(image, [np.rint(axis * 16).astype(np.int32)], False, (40, 40, 40), 8, cv2.LINE_AA, 4)
        yield image


def _detect() -> None:
    detector = SessionDetector(VisionSettings(), _INFO, list(_images()))
    for image in _images():
        detector.detect(image)


def _fit_rod() -> None:
    settings, scale = RodTrackSettings(), 3e-4
    state = SessionFilter(settings, Knowledge.stated(settings), rod_model(_INFO, settings.segments), _INFO)
    frame = LineFrame((320, 240), "left", scale)
    for axis in _axes():
        state.step(frame.line(CentrelinePx(axis[10:])), scale, 10.0, 0.1)


def _estimate() -> None:
    from . import estimate

    for model in ("fusion", "rod-3d", "links", "elastica", "pseudo-rigid"):
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
    "detection of the catheter": _detect,
    "rod in the plane": _fit_rod,
    "simulation of a camera": _simulate_camera,
    "simulation of a fluoroscope": _simulate_fluoroscope,
    "points from two views": _triangulate,
    "estimation": _estimate,
}
"""In the order in which they begin. The last one uses the compiled functions of the first two."""


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
