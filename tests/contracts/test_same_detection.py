"""Every verb detects the same catheter in the same images, and what a user states holds in each of them."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.datasets import open_source as open_session
from tipforce.estimators import create
from tipforce.io import open_source
from tipforce.pipelines import estimate, import_session, inspect, train
from tipforce.types import Catheter, DetectedShape, Frame, SessionInfo, ViewInfo
from tipforce.vision import RESOLVED_AFTER_IMAGES, ResolvedVision, SessionDetector, VisionSettings

from ..short_run import Run, draw_image, run  # type: ignore[import-not-found]

__all__ = ["run"]

SETTINGS = {"features": {"degree": 3}, "tuning_samples": 40, "max_left_out": 0.5}
Detected = dict[bytes, tuple[str, bytes]]
"""Image -> status and centreline."""


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Detected]:
    """Returns what was detected since it was called the last time."""
    seen: Detected = {}
    detect = SessionDetector.detect

    def spied(self: SessionDetector, image: np.ndarray) -> DetectedShape:
        shape = detect(self, image)
        line = b"" if shape.centreline is None else shape.centreline.points.tobytes()
        seen[image.tobytes()] = (shape.status.value, line)
        return shape

    monkeypatch.setattr(SessionDetector, "detect", spied)

    def taken() -> Detected:
        found = dict(seen)
        seen.clear()
        return found

    return taken


@pytest.fixture(scope="module")
def two_sessions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset folder: in one session the catheter comes from the left, in the other, another camera, from above."""
    folder = tmp_path_factory.mktemp("data")
    rows = ["file_name,session,stamp_ns,fx_n,fy_n"]
    rng = np.random.default_rng(0)
    for session in ("side", "above"):
        for number in range(24):
            bend = 1.2 * number / 24
            image = np.pad(draw_image(bend), ((0, 40), (0, 0)), mode="edge") + rng.normal(0.0, 2.0, (160, 160))
            image = np.clip(image, 0, 255).astype(np.uint8)
            name = f"{session}_{number:02d}.png"
            cv2.imwrite(str(folder / name), image if session == "side" else np.ascontiguousarray(image.T))
            rows.append(f"{name},{session},{number * 40_000_000},{0.05 * bend:.4f},{-0.2 * bend:.4f}")
    (folder / "metadata.csv").write_text("\n".join(rows) + "\n")
    return folder


@pytest.fixture(scope="module")
def with_empty_images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset folder of 54 images; 13 show no catheter, among them all of an even sample of ten."""
    folder = tmp_path_factory.mktemp("gaps")
    rows = ["file_name,stamp_ns,fx_n,fy_n"]
    empty = {*np.linspace(0, 53, 10).astype(int).tolist(), 20, 30, 40}
    for number in range(54):
        bend = 1.2 * number / 54
        image = np.full((120, 160), 210, np.uint8) if number in empty else draw_image(bend)
        cv2.imwrite(str(folder / f"{number:02d}.png"), image)
        rows.append(f"{number:02d}.png,{number * 40_000_000},{0.05 * bend:.4f},{-0.2 * bend:.4f}")
    (folder / "metadata.csv").write_text("\n".join(rows) + "\n")
    return folder


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    import_session(run.video, run.force, path)
    return path


def sessions_of(path: Path) -> Iterator[object]:
    for name in open_dataset(path).sessions:
        yield open_session(path, session=name)


@pytest.mark.parametrize(
    ("data", "found"),
    [
        ("two_sessions", (48, 48)),
        ("with_empty_images", (41, 54)),
        pytest.param("recording", (175, 192), marks=pytest.mark.slow),
    ],
)
def test_inspect_train_and_estimate_detect_the_same_in_the_same_images(
    data: str, found: tuple[int, int], spy: Callable[[], Detected], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path = request.getfixturevalue(data)
    result = inspect(path)
    inspected = spy()
    assert (result.figures["statuses"]["valid"], result.figures["frames"]) == pytest.approx(found, rel=0.1)
    train(path, tmp_path / "svr", estimator="svr", settings=SETTINGS)
    trained = spy()
    assert len(trained) > 40
    assert {image: inspected[image] for image in trained} == trained
    for source in sessions_of(path):
        list(estimate(tmp_path / "svr", source))  # type: ignore[arg-type]
    estimated = spy()
    assert {image: estimated[image] for image in inspected} == inspected


def test_a_video_is_inspected_as_it_is_estimated(
    recording: Path, run: Run, spy: Callable[[], Detected], tmp_path: Path
) -> None:
    train(recording, tmp_path / "svr", estimator="svr", settings=SETTINGS)
    spy()
    inspect(run.video)
    inspected = spy()
    list(estimate(tmp_path / "svr", run.video, actuation={}))
    assert spy() == inspected


def test_live_detects_as_in_a_file_of_its_first_images_once_it_has_resolved(run: Run) -> None:
    images = [event.image for event in open_source(run.video) if isinstance(event, Frame)]
    live, file = (SessionDetector(VisionSettings(), SessionInfo("s"), some) for some in ((), images[:50:5]))
    for image in images[: 50 + RESOLVED_AFTER_IMAGES]:
        assert not isinstance(live.vision, ResolvedVision), "a thread resolves it, and no image waits"
        live.detect(image)
    assert isinstance(live.vision, ResolvedVision)
    assert live.vision.base_side == file.vision.base_side
    for image in images[50 + RESOLVED_AFTER_IMAGES : 99]:
        here, there = live.detect(image), file.detect(image)
        assert here.status == there.status
        if here.centreline is not None and there.centreline is not None:
            np.testing.assert_array_equal(here.centreline.points, there.centreline.points)


def test_live_begins_with_the_detection_of_the_training_and_what_is_stated_of_its_own_view(
    two_sessions: Path, tmp_path: Path
) -> None:
    """The session states a base at the top; the training resolved another."""
    model = create("svr", SETTINGS).fit(open_dataset(two_sessions))
    stated = SessionInfo("live", views={"camera": ViewInfo(base_side="top", polarity="dark")})
    image = cv2.imread(str(two_sessions / "above_12.png"), cv2.IMREAD_GRAYSCALE)
    shape = SessionDetector(model.settings.vision, stated, (), model.fitted_.vision).detect(image)
    assert shape.found
    assert shape.base is not None
    assert shape.base.origin_px[1] < 5


DISTRACTED = SessionInfo(
    "still", Catheter("8 px", 8e-4, 12e-3, 0.0), views={"camera": ViewInfo(1e-4, base_side="left")}
)
"""A catheter 8 px thick, 120 px long, from the left."""


def with_thin_line(catheter: bool) -> np.ndarray:
    """(120, 160): a line 2 px thick comes from the top; the catheter from the left, or none."""
    image = draw_image(0.5) if catheter else np.full((120, 160), 210, np.uint8)
    cv2.line(image, (140, 0), (130, 80), 40, 1, cv2.LINE_AA)
    return image


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_what_is_stated_holds_for_fewer_images_than_detection_is_resolved_on(count: int, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(count):
        cv2.imwrite(str(folder / f"{number}.png"), with_thin_line(catheter=False))
    result = inspect(folder, bench=DISTRACTED)
    assert result.figures["statuses"] == {"no_catheter": count}
    result = inspect(folder / "0.png", bench=DISTRACTED)
    assert result.figures["status"] == "no_catheter"
    assert result.vision.base_side == "left"
    for estimator in ("rod", "beam"):
        statuses = {found.status.value for found in estimate(create(estimator), folder, bench=rod_bench())}
        assert statuses == {"no_catheter"}
    cv2.imwrite(str(folder / "0.png"), with_thin_line(catheter=True))
    assert inspect(folder / "0.png", bench=DISTRACTED).figures["status"] == "valid"


def rod_bench() -> SessionInfo:
    catheter = Catheter("8 px", 8e-4, 12e-3, 0.0, bending_stiffness_nm2=4e-4)
    return SessionInfo("still", catheter, views=DISTRACTED.views)


@pytest.mark.parametrize(
    ("catheter", "view"),
    [
        (Catheter(diameter_m=8e-4), ViewInfo(1e-4)),
        (Catheter(), ViewInfo(base_side="left")),
        (Catheter(), ViewInfo(base_region=(0, 40, 12, 80))),
        (Catheter(), ViewInfo(roi=(0, 0, 125, 120))),
    ],
    ids=["diameter and scale alone", "side", "region", "part of the image"],
)
@pytest.mark.parametrize("images", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_one_stated_fact_suffices_to_leave_the_wrong_line_out(catheter: Catheter, view: ViewInfo, images: int) -> None:
    info = SessionInfo("still", catheter, views={"camera": view})
    shown = [with_thin_line(catheter=False)] * images
    assert not SessionDetector(VisionSettings(), info, shown).detect(shown[0]).found
    assert not SessionDetector(VisionSettings(), info).detect(shown[0]).found


def test_a_stated_part_of_the_image_holds_beside_settings_that_leave_nothing_open() -> None:
    settings = VisionSettings(
        base_side="top", polarity="dark", threshold=120, diameter_px=2.0, length_px=81.0, method="tracer"
    )
    image = with_thin_line(catheter=False)
    assert SessionDetector(settings, SessionInfo(), [image]).detect(image).found
    info = SessionInfo(views={"camera": ViewInfo(roi=(0, 0, 100, 120))})
    assert not SessionDetector(settings, info, [image]).detect(image).found
