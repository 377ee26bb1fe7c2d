"""``tipforce calibrate`` for the poses of views: from DICOM, and refined from the catheter's tip."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from tipforce.calibration import moved_camera
from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.geometry import CameraModel, CArm
from tipforce.io import RecordingReader, RecordingWriter
from tipforce.types import Frame, SessionInfo, ViewInfo, read_bench

from .test_import_dicom import SCALE, write_xray  # type: ignore[import-not-found]

WIDTH, HEIGHT, FRAMES = 320, 240, 24
CAMERAS = {
    name: CArm(primary, secondary, 1.1, 0.75, 0.16e-3).camera(WIDTH, HEIGHT)
    for name, (primary, secondary) in {"a": (-30.0, 10.0), "b": (55.0, -5.0)}.items()
}
DOWN_M = 4e-3
"""Shift of the stated pose of view b along the image's down."""


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["calibrate", *map(str, words)])


def draw_image(camera: CameraModel, frame: int) -> np.ndarray:
    """(240, 320) grey: a catheter from below, whose tip moves about the isocentre in space."""
    share = np.linspace(0.0, 1.0, 60)
    phase = 2.0 * np.pi * frame / FRAMES
    bend = np.array([7e-3 * np.sin(phase), 7e-3 * np.cos(2.0 * phase), 4e-3 * np.cos(phase)])
    line = np.outer(share, (0.0, 0.0, 0.045)) + np.outer(share**2, bend) - (0.0, 0.0, 0.04)
    image = np.full((HEIGHT, WIDTH), 215, np.uint8)
    pixels = camera.project(np.vstack([line[0] - (0.0, 0.0, 0.02), line]))
    cv2.polylines(image, [np.round(pixels * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(frame).normal(0, 2, image.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def biplane(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 pairs; the stated pose of view b is off by `DOWN_M`."""
    path = tmp_path_factory.mktemp("biplane") / "biplane.mcap"
    wrong = {"a": CAMERAS["a"], "b": moved_camera(CAMERAS["b"], np.array([0.0, 0.0, 0.0, 0.0, DOWN_M, 0.0]))}
    views = {
        name: ViewInfo(0.256e-3, "bottom", polarity="dark", projection=camera.projection, projection_frame="isocentre")
        for name, camera in wrong.items()
    }
    with RecordingWriter(path, SessionInfo("biplane", views=views), lossless=True) as writer:
        for k in range(FRAMES):
            for name, camera in CAMERAS.items():
                writer.write(Frame(k * 66_000_000, draw_image(camera, k), name))
    return path


def test_the_tip_in_both_views_corrects_the_pose_of_the_second(biplane: Path, tmp_path: Path) -> None:
    result = run(biplane, "--views", "-o", tmp_path / "bench.toml")
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "views.b.pose_uncertainty_deg or pose_uncertainty_m is not stated: that of a C-arm is assumed" in said
    assert "px off their epipolar lines" in said
    info = read_bench(tmp_path / "bench.toml")
    assert info.view("a").pose_uncertainty_m == (0.0, 0.0, 0.0)
    second = info.view("b")
    assert second.projection is not None
    assert second.pose_uncertainty_m is not None
    assert second.projection_frame == "isocentre"
    found = CameraModel.from_projection(second.projection).camera_from_world.translation_m
    off = found[1] - CAMERAS["b"].camera_from_world.translation_m[1]
    assert abs(off) < min(3.0 * second.pose_uncertainty_m[1], 0.5 * DOWN_M)


def test_a_stated_pose_that_is_too_sure_is_contradicted(biplane: Path) -> None:
    stated = "[views.a]\npose_uncertainty_deg = [0.1, 0.1, 0.1]\npose_uncertainty_m = [2e-4, 2e-4, 2e-4]\n"
    bench = biplane.parent / "sure.toml"
    bench.write_text(stated + stated.replace("views.a", "views.b"))
    result = run(biplane, "--views", "--bench", bench)
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "the catheter and the stated pose of b relative to a differ (chi-square" in said
    assert "check the angles, and which file is which view. The standard deviations are widened" in said


def test_without_a_stated_pose_the_ways_to_one_are_named(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with RecordingWriter(path, SessionInfo("two"), lossless=True) as writer:
        for name, camera in CAMERAS.items():
            writer.write(Frame(0, draw_image(camera, 0), name))
    result = run(path, "--views")
    assert isinstance(result.exception, InputError)
    assert "views.a.projection is not stated; import both planes from DICOM, or find it with" in str(result.exception)


def test_one_view_has_no_pose_to_refine(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    with RecordingWriter(path, SessionInfo("one"), lossless=True) as writer:
        writer.write(Frame(0, draw_image(CAMERAS["a"], 0)))
    result = run(path, "--views")
    assert isinstance(result.exception, InputError)
    assert "view_poses=True needs a recording of two views, and this one has 1" in str(result.exception)


def test_dicom_headers_fill_bench_toml_and_every_line_stays(tmp_path: Path) -> None:
    pytest.importorskip("pydicom")
    bench = tmp_path / "bench.toml"
    bench.write_text("[catheter]\ndiameter_m = 2.33e-3  # mine\n\n[views.a]\nmetres_per_px = 3e-4  # by eye\n")
    files = write_xray(tmp_path / "IM1.dcm"), write_xray(tmp_path / "IM2.dcm", "b")
    result = run(*files, "--bench", bench, "-o", bench, "--overwrite")
    assert result.exit_code == 0, result.output
    info = read_bench(bench)
    assert list(info.views) == ["a", "b"]
    assert info.view("a").metres_per_px == pytest.approx(SCALE, rel=1e-5)
    assert info.view("b").pose_uncertainty_deg == (1.0, 1.0, 0.5)
    assert "# before: metres_per_px = 3e-4  # by eye" in bench.read_text()
    assert "diameter_m = 2.33e-3  # mine" in bench.read_text()
    target = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["import", *map(str, files), "--bench", str(bench), "-o", str(target)])
    assert result.exit_code == 0, result.output
    with RecordingReader(target) as reader:
        assert reader.session_info.view("a") == info.view("a")


def test_a_known_distance_between_electrodes_gives_the_scale_of_the_named_view(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    assert run("--ruler", "240,100,252,116,5", "--view", "b", "-o", bench).exit_code == 0
    info = read_bench(bench)
    assert info.view("b").metres_per_px == pytest.approx(5e-3 / 20.0)
    assert info.view("b").metres_per_px_uncertainty == pytest.approx(2**0.5 / 20.0, rel=0.01)


def test_the_diameter_of_the_shaft_gives_a_rough_scale_of_each_view(biplane: Path, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text("[catheter]\ndiameter_m = 2.7e-3\n")
    assert run(biplane, "--diameter", "--bench", bench, "-o", tmp_path / "new.toml").exit_code == 0
    for view in CAMERAS:  # OpenCV draws the line 11.4 px wide
        found = read_bench(tmp_path / "new.toml").view(view)
        assert found.metres_per_px == pytest.approx(2.7e-3 / 11.44, rel=0.04)
        assert found.metres_per_px_uncertainty == pytest.approx(0.065, abs=0.005)
    result = run(biplane, "--diameter")
    assert "catheter.diameter_m is not stated, and the scale is to come from it" in str(result.exception)


def test_dicom_and_a_ruler_are_two_commands(tmp_path: Path) -> None:
    pytest.importorskip("pydicom")
    result = run(write_xray(tmp_path / "IM1.dcm"), "--ruler", "1,2,100,3,5")
    assert isinstance(result.exception, InputError)
    assert "DICOM is one way to calibrate views, without the bench; leave out a ruler" in str(result.exception)
