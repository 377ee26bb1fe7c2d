"""Images and videos as cameras and telephones leave them."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.errors import FileFormatError
from tipforce.io import open_source, read_image, write_video
from tipforce.types import Frame

RAMP = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))
WIDE = RAMP.astype(np.uint16)


@pytest.mark.parametrize(
    ("name", "pixels"),
    [
        ("grey.png", RAMP),
        ("sixteen.tif", WIDE * 257),
        ("sixteen.png", WIDE * 257),
        ("twelve.tif", WIDE * 16),
        ("alpha.png", np.dstack([RAMP, RAMP, RAMP, np.full_like(RAMP, 9)])),
        ("alpha16.png", np.dstack([WIDE * 257] * 4)),
        ("Prüfstand 3 [neu].png", RAMP),
    ],
)
def test_an_image_of_any_depth_is_read_with_its_brightness(tmp_path: Path, name: str, pixels: np.ndarray) -> None:
    (tmp_path / name).write_bytes(cv2.imencode(Path(name).suffix, pixels)[1].tobytes())
    image = read_image(tmp_path / name)
    assert image.dtype == np.uint8
    grey = image if image.ndim == 2 else image[..., 0]
    np.testing.assert_array_equal(grey, RAMP)
    assert image.shape[2:] in ((), (3,))


def test_pixels_that_are_no_grey_levels_are_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "f.tif"), RAMP.astype(np.float32))
    with pytest.raises(FileFormatError, match="write it with 8 or 16 bit"):
        read_image(tmp_path / "f.tif")


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Six seconds, the left half dark; key frames every 250 frames."""
    image = np.full((48, 64), 200, np.uint8)
    image[:, :32] = 40
    rough = np.random.default_rng(0).integers(0, 30, (150, 48, 64), dtype=np.uint8)
    write_video(tmp_path / "v.mp4", (Frame(k * 40_000_000, image + rough[k]) for k in range(150)), 25)
    return tmp_path / "v.mp4"


def frames_of(path: Path) -> list[Frame]:
    return [event for event in open_source(path) if isinstance(event, Frame)]


@pytest.mark.parametrize(("matrix", "dark"), [((0, 1, -1, 0), "top"), ((-1, 0, 0, -1), "right")], ids=["90", "180"])
def test_a_video_that_was_filmed_upright_is_turned_as_a_player_does(
    video: Path, matrix: tuple[int, int, int, int], dark: str
) -> None:
    raw = bytearray(video.read_bytes())
    at = raw.find(b"tkhd") + 44  # name, version and flags, times, layer and volume stand before the matrix
    a, b, c, d = (value << 16 for value in matrix)
    raw[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    video.write_bytes(raw)
    image = frames_of(video)[0].image[..., 0]
    assert image.shape == ((64, 48) if dark == "top" else (48, 64))
    part = {"top": image[:28], "right": image[:, 36:]}[dark]
    assert part.max() < 100 < 180 < np.median(np.setdiff1d(image, part))


def test_a_video_that_lacks_only_its_last_bytes_is_called_cut_off(video: Path) -> None:
    video.write_bytes(video.read_bytes()[:-100])
    with pytest.raises(FileFormatError, match="its last 100 bytes are missing"):
        frames_of(video)


def test_frames_made_from_a_damaged_one_are_left_out_and_counted(video: Path) -> None:
    raw = bytearray(video.read_bytes())
    middle = raw.find(b"mdat") + (len(raw) - raw.find(b"mdat")) * 3 // 4
    raw[middle : middle + 400] = bytes(k * 37 % 256 for k in range(400))
    video.write_bytes(raw)
    with pytest.warns(UserWarning, match="damaged frames were left out, the first at"):
        found = frames_of(video)
    assert 75 < len(found) < 140
    assert all(frame.image[10:40, 4:28].max() < 100 for frame in found)
