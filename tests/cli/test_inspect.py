"""``tipforce inspect``: images, videos, recordings."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import FileFormatError, InputError
from tipforce.io import RecordingWriter, save_image
from tipforce.pipelines import inspect_image_file
from tipforce.types import Frame, SessionInfo, Wrench
from tipforce.vision import ShapeFeatureSettings, VisionSettings


def run(*words: object) -> object:
    return CliRunner().invoke(app, ["inspect", *map(str, words)], catch_exceptions=False)


@pytest.fixture
def frame(tube, tmp_path: Path) -> Path:
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), tube("bent", noise=4))
    return path


@pytest.mark.parametrize("method", ["tracer", "classic"])
def test_an_image_is_drawn_and_described(frame: Path, tmp_path: Path, method: str, axis_of) -> None:
    drawn, table = tmp_path / "d.png", tmp_path / "d.json"
    result = run(frame, "-o", drawn, "--json", table, "--set", f"vision.method={method}")
    assert result.exit_code == 0, result.output
    figures = json.loads(table.read_text())
    assert figures["status"] == "valid"
    assert list(figures["features"]) == ["A1", "A2", "A3", "A4", "A5"]
    assert figures["diameter_px"] == pytest.approx(13, abs=2)
    assert np.hypot(*(np.array(figures["tip_px"]) - axis_of("bent")[-1])) < 12
    assert figures["vision"]["base_side"] == "left"
    image = cv2.imread(str(drawn))
    assert image.shape == (480, 640, 3)
    assert image.std(axis=2).max() > 80, "the drawing has colours, the frame has none"
    for word in ("base", "tip", "diameter", "A1"):
        assert word in result.stderr


def test_the_drawing_lands_beside_the_person_by_default(frame: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(frame)
    assert (tmp_path / "frame-inspect.png").stat().st_size > 1000


def test_what_is_there_is_replaced_on_wish_only(frame: Path, tmp_path: Path) -> None:
    for there in ("drawing.png", "drawing-figure18.png"):
        (tmp_path / there).write_text("mine")
        with pytest.raises(InputError, match=f"{there}: exists already; choose another name or state --overwrite"):
            run(frame, "-o", tmp_path / "drawing.png", "--figures")
        assert (tmp_path / there).read_text() == "mine"
        (tmp_path / there).unlink()
    for _ in range(2):
        run(frame, "-o", tmp_path / "drawing.png", "--overwrite")


def test_the_thesis_figures_are_drawn_on_wish(frame: Path, tmp_path: Path) -> None:
    run(frame, "-o", tmp_path / "frame-inspect.png", "--figures")
    for number in (17, 18):
        assert cv2.imread(str(tmp_path / f"frame-figure{number}.png")).shape[1] > 600


def test_a_hook_has_no_polynomial_but_an_angle_series(tube, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "hook.png"), tube("hook"))
    refused = run(tmp_path / "hook.png", "-o", tmp_path / "a.png")
    assert "past 90 degrees" in refused.stderr
    table = tmp_path / "t.json"
    run(tmp_path / "hook.png", "-o", tmp_path / "b.png", "--set", "features.kind=legendre", "--json", table)
    series = json.loads(table.read_text())["features"]
    assert series["L0"] + series["L1"] + series["L2"] == pytest.approx(3.2, abs=0.5)


def test_an_image_without_a_catheter_says_why(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((240, 320), 180, np.uint8))
    result = run(tmp_path / "grey.png", "-o", tmp_path / "d.png", "--json", tmp_path / "t.json")
    assert result.exit_code == 0
    assert "not found" in result.stderr
    figures = json.loads((tmp_path / "t.json").read_text())
    assert figures["status"] == "no_catheter"
    assert figures["features"] is None


def test_a_video_is_counted_and_put_on_a_contact_sheet(video: Path, tmp_path: Path) -> None:
    table = tmp_path / "t.json"
    result = run(video, "-o", tmp_path / "sheet.png", "--json", table, "--drawn", 6)
    figures = json.loads(table.read_text())
    assert figures["frames"] == 20
    assert figures["share_found"] == pytest.approx(0.9)
    assert "found in 18 of 20 frames" in result.stderr
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[1] == 4 * 324 + 4
    assert sheet.shape[0] == 2 * (240 + 22 + 4) + 4


def test_the_images_of_a_folder_are_named(frame: Path, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("a.png", "b.png", "c.png"):
        (folder / name).write_bytes(frame.read_bytes())
    cv2.imwrite(str(folder / "d.png"), np.full((120, 160), 210, np.uint8))
    result = run(folder, "-o", tmp_path / "s.png", "--json", tmp_path / "t.json")
    images = json.loads((tmp_path / "t.json").read_text())["images"]
    assert images == {"a.png": "valid", "b.png": "valid", "c.png": "valid", "d.png": "no_catheter"}
    assert "not found in d.png" in result.stderr


def test_every_other_frame_of_a_video_is_half_the_work(video: Path, tmp_path: Path) -> None:
    run(video, "-o", tmp_path / "s.png", "--json", tmp_path / "t.json", "--every", 2)
    assert json.loads((tmp_path / "t.json").read_text())["frames"] == 10


def test_a_recording_shows_its_streams_and_a_plot(tube, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo(name="run")) as writer:
        for k in range(10):
            writer.write(Frame(k * 40_000_000, tube("bent")[::4, ::4].copy()))
            writer.write(Wrench(k * 40_000_000, np.array([0.1, 0.01 * k, 0.0]), np.zeros(3)))
    result = run(path, "-o", tmp_path / "plot.png", "--json", tmp_path / "t.json")
    assert result.exit_code == 0, result.output
    assert "camera" in result.stderr
    assert "10 frames" in result.stderr
    assert cv2.imread(str(tmp_path / "plot.png")) is not None
    assert set(json.loads((tmp_path / "t.json").read_text())["streams"]) == {"camera", "force"}
    looked = run(path, "--frames", "-o", tmp_path / "sheet.png")
    assert "of 10 frames" in looked.stderr


@pytest.mark.parametrize("words", [["--set", "vision.polarity=light"], ["--every", "2"], ["--drawn", "3"]])
def test_what_is_of_images_is_refused_for_the_streams_of_a_recording(words: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"add --frames$"):
        run(tmp_path / "run.mcap", "-o", tmp_path / "out.png", *words)


def test_what_is_no_image_is_named(tmp_path: Path) -> None:
    fake = tmp_path / "fake.png"
    fake.write_text("not an image")
    with pytest.raises(FileFormatError, match=r"fake\.png"):
        inspect_image_file(fake, VisionSettings(), ShapeFeatureSettings())


@pytest.mark.parametrize("target", ["file/drawing.png", "drawing.gif"])
def test_a_drawing_that_cannot_be_written_is_refused(tmp_path: Path, target: str) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError):
        save_image(tmp_path / target, np.zeros((4, 4, 3), np.uint8))


def test_a_setting_that_does_not_exist_is_named(frame: Path) -> None:
    with pytest.raises(InputError, match="there is no such setting"):
        run(frame, "--set", "colour=blue")


def test_settings_that_were_found_are_said_to_be_so(frame: Path, tmp_path: Path) -> None:
    found = run(frame, "-o", tmp_path / "d.png", "--overwrite")
    assert "found automatically" in found.stderr
    stated = [
        word
        for key in ("method=tracer", "polarity=dark", "base_side=left", "threshold=130", "diameter_px=13")
        for word in ("--set", f"vision.{key}")
    ]
    assert "found automatically" not in run(frame, "-o", tmp_path / "d.png", "--overwrite", *stated).stderr
