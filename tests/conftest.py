"""Settings of all tests, and images of a tube along a curve whose numbers are known."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:
    # Several processes share the cores: threads and processes of each would wait for one another.
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # numpy looks at it when it is imported, below
    os.environ.setdefault("TIPFORCE_CORES", "1")

import fcntl
import gc
import hashlib
import pickle
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings

from tipforce._system.cores import cores
from tipforce.geometry import curve_from_angle
from tipforce.types import BasePose

if "PYTEST_XDIST_WORKER" in os.environ:
    cv2.setNumThreads(1)
gc.disable()  # nearly all that the collection of the tests makes is kept: the collector of garbage would search in vain

# The first example of a test may compile the hot loops. The same examples every time, so that a change is judged by
# what it changes; `make prove` looks for new ones.
settings.register_profile("house", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("house")

SHAPES = {"bent": [0.4, 0.5, 0.1], "hook": [1.2, 1.7, 0.3], "long": [0.1, 0.1], "straight": [0.0, 0.0]}
"""Legendre coefficients of the tangent angle: "hook" comes back towards its base, "long" leaves the image."""


def _axis(shape: str) -> np.ndarray:
    length = 820.0 if shape == "long" else 420.0
    return BasePose(np.array([-30.0, 340.0]), -0.05).to_image(curve_from_angle(np.array(SHAPES[shape]), length, 200))


FIRST = (
    "tests/contracts/test_estimators",
    "tests/alignment/test_timing",
    "tests/pipelines/test_import_session",
    "tests/simulation",
    "tests/contracts",
    "tests/cli",
    "tests/estimators",
    "tests/evaluation",
    "tests/training",
)
"""Files that begin: long ones. The first makes the bench that others share, before any other process asks for it."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than there are cores: tests that wait, for a browser or a clock, would leave a core idle."""
    return cores() + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, so that no process is left with one at the end."""
    rank = {start: place for place, start in enumerate(FIRST)}

    def place(item: pytest.Item) -> int:
        return next((rank[start] for start in FIRST if item.nodeid.startswith(start)), len(FIRST))

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """What the modules loaded stays: the collector of garbage need not look through it again and again."""
    gc.collect()
    gc.freeze()
    gc.enable()


def _shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of this run that all of its processes see."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


def _kept(compute: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """``compute(*inputs, **named)``, whose results are kept in ``folder`` by the bytes of its inputs.

    One of the inputs may be the folder of a network.
    """

    def call(*inputs: Any, **named: Any) -> Any:
        folders = [each for each in (*inputs, *named.values()) if isinstance(each, Path)]
        graphs = [graph for each in folders for graph in sorted(each.glob("*.onnx"))]
        changed = [path.stat().st_mtime_ns for path in graphs]
        given = pickle.dumps((compute.__name__, inputs, named, changed))
        path = folder / hashlib.blake2b(given, digest_size=16).hexdigest()
        if not path.is_file():
            part = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
            part.write_bytes(pickle.dumps(compute(*inputs, **named)))
            part.replace(path)
        return pickle.loads(path.read_bytes())

    return call


@pytest.fixture(scope="session", autouse=True)
def _same_inputs_are_computed_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Many tests detect the catheter in the same images and import the same run.

    The detector reads each image once with the same prompts, and the clock map of a run is found once. The tests of the
    clock map itself call its function directly.
    """
    from tipforce.alignment import _find_clock
    from tipforce.vision import _advice, _by_locator
    from tipforce.vision.locator import _locate, _reading, _session

    folder = _shared_folder(tmp_path_factory) / "computed-once"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_locate, "rough_points", _kept(_locate.rough_points, folder))
        patch.setattr(_reading, "refine", _kept(_reading.refine, folder))
        for module in (_session, _by_locator, _advice):
            patch.setattr(module, "locate", _kept(_locate.locate, folder))
        patch.setattr(_find_clock, "estimate_clock", _kept(_find_clock.estimate_clock, folder))
        yield


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], None]], Path]:
    """(name, what fills a folder) -> the folder, filled by the first process of a run that asks; not to be changed."""
    root = _shared_folder(tmp_path_factory)

    def folder_of(name: str, fill: Callable[[Path], None]) -> Path:
        folder = root / name
        with (root / f"{name}.lock").open("a+") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another process waits until the folder is whole
            lock.seek(0)
            if lock.read() != "whole":
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                lock.write("whole")
        return folder

    return folder_of


def _empty_drawing(slug: str) -> Any:
    from tipforce.evaluation.report._style import Drawing

    return Drawing(slug, "nothing", "<svg></svg>", "<svg></svg>")


@pytest.fixture
def no_method_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports with one empty drawing a method, for tests that look at none: to draw them all takes seconds."""
    monkeypatch.setattr(
        "tipforce.evaluation.report._html.method_drawings",
        lambda _evaluation, method, *_: [_empty_drawing(f"{method}-drawing")],
    )


@pytest.fixture
def no_head_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without the figures before the sections of the methods."""
    empty = {name: _empty_drawing(name) for name in ("splits", "comparison")}
    monkeypatch.setattr("tipforce.evaluation.report._html.head_drawings", lambda *_: empty)


@pytest.fixture
def no_figures(no_method_figures: None, no_head_figures: None) -> None:
    """Reports whose drawings are empty."""


@pytest.fixture
def axis_of() -> Callable[[str], np.ndarray]:
    """Name of a shape -> (200, 2) image points of its axis, from beyond the left border to the tip."""
    return _axis


@pytest.fixture
def tube() -> Callable[..., np.ndarray]:
    """Name of a shape -> (480, 640) grey image of a dark tube, 12 px wide, on light ground."""

    def draw(shape: str, noise: float = 0.0) -> np.ndarray:
        image = np.full((480, 640), 220, np.uint8)
        cv2.polylines(image, [np.round(_axis(shape) * 16).astype(np.int32)], False, 40, 12, cv2.LINE_AA, 4)
        rough = image + np.random.default_rng(0).normal(0, noise, image.shape)
        return np.clip(np.rint(rough), 0, 255).astype(np.uint8)

    return draw


@pytest.fixture(scope="session")
def chromium() -> str:
    """Where Debian's chromium is; installed where that is possible, else the test is skipped."""
    found = shutil.which("chromium")
    if found is None and os.geteuid() == 0 and shutil.which("apt-get"):
        subprocess.run(["apt-get", "install", "-y", "-q", "chromium"], capture_output=True, timeout=300, check=False)
        found = shutil.which("chromium")
    if found is None:
        pytest.skip("Debian's chromium is not installed, and apt-get cannot install it here")
    return found
