"""The size of an image is held to a limit before anything is decoded."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError
from tipforce.io import StreamDepth, read_image
from tipforce.io._image_size import MAX_MEGAPIXELS, encoded_size

GREY = np.full((48, 64), 7, np.uint8)
HUGE = 60_000


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png() -> bytes:
    head = struct.pack(">IIBBBBB", HUGE, HUGE, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")


def changed(kind: str, old: bytes, new: bytes) -> bytes:
    data = cv2.imencode(kind, GREY)[1].tobytes()
    assert old in data
    return data.replace(old, new, 1)


CLAIMS = {
    "png": png(),
    "jpg": changed(".jpg", struct.pack(">HH", 48, 64), struct.pack(">HH", HUGE, HUGE)),
    "bmp": changed(".bmp", struct.pack("<ii", 64, 48), struct.pack("<ii", HUGE, -HUGE)),
    "tif": changed(".tif", struct.pack("<HHIHH", 256, 3, 1, 64, 0), struct.pack("<HHII", 256, 4, 1, HUGE**2)),
    "webp": b"RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0" + bytes(4) + b"\xff\xff\x7f" * 2,
}


@pytest.mark.parametrize("kind", CLAIMS)
def test_an_image_that_claims_gigabytes_is_refused_by_its_header(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"claim.{kind}"
    path.write_bytes(CLAIMS[kind])
    with pytest.raises(FileFormatError, match=r"claim.*claims \d+ x \d+ pixels, more than .* 100 megapixels.*MEGAPIX"):
        read_image(path)
    assert StreamDepth.of_files([path]).bits == 12  # what is not read counts for nothing


@pytest.mark.parametrize("kind", [".png", ".jpg", ".bmp", ".tif", ".webp"])
@pytest.mark.parametrize("size", [(48, 64), (1, 1), (2, 2), (1, 640), (480, 1)])
def test_the_size_in_the_header_is_that_of_the_image(kind: str, size: tuple[int, int]) -> None:
    data = cv2.imencode(kind, np.full(size, 7, np.uint8))[1].tobytes()
    assert encoded_size(data) == size[::-1]
    for end in range(min(len(data), 64)):
        encoded_size(data[:end])  # whatever is cut off, there is no exception


def test_bytes_between_the_segments_of_a_jpeg_do_not_hide_its_size_nor_take_long(tmp_path: Path) -> None:
    data = cv2.imencode(".jpg", GREY)[1].tobytes()
    assert encoded_size(data[:2] + b"\xff" * 7 + data[3:]) == (64, 48)
    assert encoded_size(data[:2] + bytes(1 << 24)) is None
    assert encoded_size(data[:2] + b"\xff" * (1 << 24)) is None


def test_the_limit_can_be_stated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((1001, 1000), np.uint8))
    monkeypatch.setenv(MAX_MEGAPIXELS, "1")
    with pytest.raises(FileFormatError, match="more than the limit of 1 megapixels"):
        read_image(tmp_path / "a.png")
    monkeypatch.setenv(MAX_MEGAPIXELS, "1.1")
    assert read_image(tmp_path / "a.png").shape == (1001, 1000)
    monkeypatch.setenv(MAX_MEGAPIXELS, "many")
    with pytest.raises(InputError, match="TIPFORCE_MAX_MEGAPIXELS=many: expected a number from 1 to 10000"):
        read_image(tmp_path / "a.png")


def test_a_file_longer_than_any_image_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "long.png").open("wb") as stream:
        stream.truncate(1 << 40)  # a hole, not a terabyte
    with pytest.raises(FileFormatError, match="more than the largest image that is read"):
        read_image(tmp_path / "long.png")


@pytest.mark.parametrize("length", [0x7FFFFFFF, 0xFFFFFFFF, 100_000])
def test_a_chunk_of_a_png_that_claims_more_than_the_file_is_refused(tmp_path: Path, length: int) -> None:
    data = cv2.imencode(".png", np.zeros((9, 9), np.uint8))[1].tobytes()
    (tmp_path / "a.png").write_bytes(data[:33] + length.to_bytes(4, "big") + data[37:])
    with pytest.raises(FileFormatError, match=r"a\.png: the image is missing, empty or damaged"):
        read_image(tmp_path / "a.png")
