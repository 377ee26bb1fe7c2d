"""Names of images, and the images that are read by them: folders, recordings, videos, folders of recordings."""

from pathlib import Path

import numpy as np
import pytest

from tipforce.annotation import AnnotationImages
from tipforce.errors import FileFormatError, InputError
from tipforce.io import RecordingWriter, save_image, write_video
from tipforce.types import Frame, SessionInfo

from .conftest import bends, draw  # type: ignore[import-not-found]


def frames(count: int = 6) -> list[Frame]:
    return [Frame(k * 40_000_000, draw(bends()[k])) for k in range(count)]


def record(path: Path) -> Path:
    with RecordingWriter(path, SessionInfo(path.stem), lossless=True) as writer:
        for frame in frames():
            writer.write(frame)
    return path


def test_images_of_a_folder_have_the_names_of_their_files(images: AnnotationImages) -> None:
    assert len(images) == 14
    last, first = images.read(["img013.png", "img000.png"])
    assert np.array_equal(first, draw(bends()[0]))
    assert np.array_equal(last, draw(bends()[13]))


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("img003.png", "img003.png"),
        ("labeled-data/monday/img003.png", "img003.png"),
        ("C:\\data\\img003.png", "img003.png"),
        ("3", "img003.png"),
        ("99", None),
        ("other.png", None),
    ],
)
def test_an_image_is_found_by_the_name_that_another_program_gives_it(
    images: AnnotationImages, name: str, found: str | None
) -> None:
    assert images.resolve(name) == found


@pytest.mark.parametrize("name", ["run.mcap/4", "4", "labeled-data/run/img0004.png"])
def test_a_frame_of_a_recording_is_found_by_its_number(tmp_path: Path, name: str) -> None:
    images = AnnotationImages(record(tmp_path / "run.mcap"))
    assert images.resolve(name) == "run.mcap/4"
    assert np.array_equal(images.read(["run.mcap/4"])[0], draw(bends()[4]))


def test_a_frame_of_a_video_is_found_by_its_number(tmp_path: Path) -> None:
    write_video(tmp_path / "run.mp4", frames(), 25.0)
    images = AnnotationImages(tmp_path / "run.mp4")
    assert len(images) == 6
    (image,) = images.read(["run.mp4/5"])
    assert np.abs(image.astype(float) - draw(bends()[5])).mean() < 12
    assert [each.name for each in images.candidates()] == [f"run.mp4/{k}" for k in range(6)]


def test_frames_of_several_recordings_carry_their_file(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap")
    record(tmp_path / "b.mcap")
    images = AnnotationImages(tmp_path)
    assert len(images) == 12
    assert images.session_of("b.mcap/3") == 1
    assert images.resolve("3") is None  # of which one?
    assert images.resolve("runs/b.mcap/3") == "b.mcap/3"
    assert [each.session for each in images.candidates()] == [0] * 6 + [1] * 6
    assert np.array_equal(images.read(["b.mcap/2", "a.mcap/1"])[1], draw(bends()[1]))


def test_candidates_of_long_recordings_are_spread(images: AnnotationImages, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tipforce.annotation._images.MAX_CANDIDATES", 5)
    assert [each.name for each in images.candidates()] == [f"img{k:03d}.png" for k in (0, 3, 6, 9, 12)]


def test_images_in_sub_folders_are_found_and_sorted_by_number(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for k in (10, 9, 2):
        save_image(tmp_path / "images" / f"{k}.png", draw(bends()[k]))
    images = AnnotationImages(tmp_path)
    assert images.examples == ["images/2.png", "images/9.png", "images/10.png"]
    assert images.resolve("9.png") == "images/9.png"
    assert np.array_equal(images.read(["images/10.png"])[0], draw(bends()[10]))
    assert len(images.beforehand(0)) == 3


def test_a_view_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no view 'side', it has camera: set vision.view=camera"):
        AnnotationImages(record(tmp_path / "run.mcap"), "side")


def test_a_path_without_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="there is no such file or folder"):
        AnnotationImages(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="holds no images"):
        AnnotationImages(tmp_path / "empty")
