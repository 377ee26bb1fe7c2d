"""Several images in one file, and the order of several files."""

import warnings
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from tipforce.errors import FileFormatError
from tipforce.io import frame_count, open_source, read_image
from tipforce.types import Frame

LEVELS = [5 * number for number in range(30)]


def grey(level: int, size: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.full(size, level, np.uint8)


def levels_of(path: Path) -> list[int]:
    return [int(event.image.flat[0]) for event in open_source(path) if isinstance(event, Frame)]


def test_all_pages_of_a_tiff_stack_are_read(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    cv2.imwritemulti(str(path), [grey(level) for level in LEVELS])
    source = open_source(path)
    assert frame_count(source) == 30
    frames = [event for event in source if isinstance(event, Frame)]
    assert [int(frame.image[0, 0]) for frame in frames] == LEVELS
    assert [frame.stamp_ns for frame in frames] == [number * 1_000_000_000 for number in range(30)]
    names = source.file_names  # type: ignore[attr-defined]
    assert [names[frame.stamp_ns] for frame in frames][:2] == ["stack.tif page 1", "stack.tif page 2"]


def test_the_brightest_page_decides_the_depth_of_all(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    dim, bright = np.full((48, 64), 4000, np.uint16), np.full((48, 64), 60000, np.uint16)
    cv2.imwritemulti(str(path), [dim, dim])
    assert levels_of(path) == [250, 250]
    cv2.imwritemulti(str(path), [dim, bright])
    assert levels_of(path) == [15, 234]


def with_kind_of_second_page(data: bytes, kind: int) -> bytes:
    """A little-endian TIFF file whose second page states that it is of ``kind`` (1: a smaller copy)."""
    raw = bytearray(data)
    first = int.from_bytes(raw[4:8], "little")
    count = int.from_bytes(raw[first : first + 2], "little")
    after = first + 2 + 12 * count
    second = int.from_bytes(raw[after : after + 4], "little")
    tags = [raw[at : at + 12] for at in range(second + 2, second + 2 + 12 * raw[second], 12)]
    kept = [tag for tag in tags if int.from_bytes(tag[:2], "little") != 254]
    stated = (254).to_bytes(2, "little") + (4).to_bytes(2, "little") + (1).to_bytes(4, "little")
    entries = stated + kind.to_bytes(4, "little") + b"".join(kept)
    moved = len(raw)
    raw += (len(kept) + 1).to_bytes(2, "little") + entries + bytes(4)
    raw[after : after + 4] = moved.to_bytes(4, "little")
    return bytes(raw)


def test_a_thumbnail_in_a_tiff_file_is_no_page(tmp_path: Path) -> None:
    whole, data = cv2.imencodemulti(".tif", [grey(200), grey(90, (12, 16))])
    assert whole
    (tmp_path / "a.tif").write_bytes(with_kind_of_second_page(data.tobytes(), 1))
    assert levels_of(tmp_path / "a.tif") == [200]
    assert int(read_image(tmp_path / "a.tif")[0, 0]) == 200


def test_pages_of_different_sizes_are_refused(tmp_path: Path) -> None:
    cv2.imwritemulti(str(tmp_path / "a.tif"), [grey(200), grey(90, (12, 16))])
    with pytest.raises(
        FileFormatError, match=r"differ in size: 64 x 48 pixels \(page 1\) and 16 x 12 pixels \(page 2\)"
    ):
        open_source(tmp_path / "a.tif")


def test_a_stack_among_other_images_is_refused_and_both_remedies_help(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.tif"), grey(7))
    cv2.imwritemulti(str(folder / "b.tif"), [grey(1), grey(2)])
    with pytest.raises(FileFormatError, match=r"b\.tif: holds several images .* open this file by itself"):
        levels_of(folder)
    assert levels_of(folder / "b.tif") == [1, 2]
    (folder / "b.tif").unlink()
    for number in (1, 2):
        cv2.imwrite(str(folder / f"b{number}.tif"), grey(number))
    assert levels_of(folder) == [7, 1, 2]


def test_a_moving_png_is_read_as_a_video_with_its_own_stamps(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.png"), "w", format="apng") as container:
        stream = container.add_stream("apng", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray"
        for level in LEVELS[:5]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey(level), format="gray")))
        container.mux(stream.encode(None))
    frames = [event for event in open_source(tmp_path / "a.png") if isinstance(event, Frame)]
    assert [int(frame.image[0, 0]) for frame in frames] == LEVELS[:5]
    assert [frame.stamp_ns for frame in frames] == [number * 40_000_000 for number in range(5)]
    with pytest.raises(FileFormatError, match="holds several images"):
        read_image(tmp_path / "a.png")


def test_a_moving_webp_is_refused(tmp_path: Path) -> None:
    animation = cv2.Animation()
    animation.frames = [np.full((48, 64, 3), level, np.uint8) for level in (10, 200)]
    animation.durations = [40, 40]
    cv2.imwriteanimation(str(tmp_path / "a.webp"), animation)
    with pytest.raises(FileFormatError, match=r"is an animation, which is not read; write its images to a folder"):
        open_source(tmp_path / "a.webp")


def folder_of(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for level, name in enumerate(names):
        cv2.imwrite(str(folder / name), grey(level))
    return folder


def test_images_are_taken_in_the_order_of_their_numbers_and_it_is_said(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "images", [f"image{number}.png" for number in range(1, 31)])
    with pytest.warns(
        UserWarning, match=r"numbers in their names, image1\.png to image30\.png: image 2 is image2\.png"
    ):
        source = open_source(folder)
    assert [int(event.image[0, 0]) for event in source if isinstance(event, Frame)] == list(range(30))


def test_another_order_is_stated_in_a_table_as_the_message_advises(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "images", [f"image{number}.png" for number in range(1, 12)])
    with pytest.warns(UserWarning, match=r"for another order write a stamps\.csv with the columns file_name,stamp_ns"):
        open_source(folder)
    by_letters = sorted(path.name for path in folder.iterdir())
    rows = [f"{name},{number}" for number, name in enumerate(by_letters)]
    (folder / "stamps.csv").write_text("file_name,stamp_ns\n" + "\n".join(rows) + "\n")
    assert levels_of(folder)[:3] == [0, 9, 10]


@pytest.mark.parametrize("names", [["f_001.png", "f_002.png", "f_010.png"], ["a.png", "b.png"]])
def test_nothing_is_said_where_both_orders_are_the_same(tmp_path: Path, names: list[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert levels_of(folder_of(tmp_path / "images", sorted(names))) == list(range(len(names)))
