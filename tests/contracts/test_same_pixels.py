"""Training and inference see the same pixels, whatever kind of file they come in."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.io import open_source
from tipforce.pipelines import import_session
from tipforce.types import Frame

RAMP = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))
DIM = RAMP // 5
"""Its brightest value alone would make another depth likely."""
COUNT = 3


def stretched(grey: np.ndarray, bits: int) -> np.ndarray:
    """``grey`` with ``bits`` in use, in a type that holds them; the upper eight are the grey levels."""
    return grey if bits == 8 else (grey.astype(np.uint16) << (bits - 8)) + np.uint16(3)


def coloured(grey: np.ndarray, channels: str) -> np.ndarray:
    """One grey channel, three, or four with a transparency that nobody may see."""
    return grey if channels == "grey" else np.dstack([grey] * (3 if channels == "colour" else 4))


def write_folder(folder: Path, images: list[np.ndarray], suffix: str = ".png") -> Path:
    """A dataset folder, which is an image folder with stamps too."""
    folder.mkdir()
    rows = ["file_name,stamp_ns,fx_n"]
    for k, image in enumerate(images):
        (folder / f"{k}{suffix}").write_bytes(cv2.imencode(suffix, image)[1].tobytes())
        rows.append(f"{k}{suffix},{k * 40_000_000},0.{k}")
    (folder / "metadata.csv").write_text("\n".join(rows) + "\n")
    return folder


def trained_on(path: Path) -> list[np.ndarray]:
    return [each.views["camera"] for each in open_dataset(path).observations()]  # type: ignore[misc]


def estimated_on(path: Path) -> list[np.ndarray]:
    with open_source(path) as source:
        return [event.image for event in source if isinstance(event, Frame)]


@pytest.mark.parametrize("channels", ["grey", "colour", "alpha"])
@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_folder_has_the_same_pixels_as_a_dataset_and_as_a_source(
    tmp_path: Path, bits: int, channels: str, suffix: str
) -> None:
    images = [coloured(stretched(grey, bits), channels) for grey in (DIM, RAMP, DIM)]
    folder = write_folder(tmp_path / "session", images, suffix)
    trained, estimated = trained_on(folder), estimated_on(folder)
    assert len(trained) == len(estimated) == COUNT
    for a, b, grey in zip(trained, estimated, (DIM, RAMP, DIM), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == np.uint8
        np.testing.assert_array_equal(a if a.ndim == 2 else a[..., 1], grey)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_recording_and_shards_keep_the_pixels_of_the_folder(tmp_path: Path, bits: int) -> None:
    folder = write_folder(tmp_path / "session", [stretched(grey, bits) for grey in (DIM, RAMP, DIM)])
    import_session(folder, None, tmp_path / "run.mcap", lossless=True)
    for a, b in zip(estimated_on(tmp_path / "run.mcap"), estimated_on(folder), strict=True):
        np.testing.assert_array_equal(a, b)
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    cells = [{"bytes": (folder / f"{k}.png").read_bytes(), "path": f"{k}.png"} for k in range(COUNT)]
    table = {"image": cells, "stamp_ns": [0, 1, 2], "fx_n": [0.0, 0.1, 0.2]}
    (tmp_path / "shards").mkdir()
    parquet.write_table(arrow.table(table), tmp_path / "shards" / "a.parquet", row_group_size=1)
    for a, b in zip(trained_on(tmp_path / "shards"), estimated_on(folder), strict=True):
        np.testing.assert_array_equal(a, b)


def with_stated_bits(png: bytes, bits: int) -> bytes:
    """``png`` (16-bit grey) with a chunk that states how many bits are in use."""
    chunk = b"sBIT" + bytes([bits])
    at = 8 + 25  # behind the signature and IHDR
    return png[:at] + struct.pack(">I", 1) + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[at:]


@pytest.mark.parametrize("door", [trained_on, estimated_on])
def test_the_bits_that_a_file_states_count_more_than_its_pixels(
    tmp_path: Path, door: Callable[[Path], list[np.ndarray]]
) -> None:
    folder = write_folder(tmp_path / "session", [stretched(DIM, 10)] * 2)
    for path in folder.glob("*.png"):
        path.write_bytes(with_stated_bits(path.read_bytes(), 10))
    for image in door(folder):
        np.testing.assert_array_equal(image, DIM)


@pytest.mark.parametrize("door", [trained_on, estimated_on])
def test_one_bright_image_decides_for_its_whole_stream(
    tmp_path: Path, door: Callable[[Path], list[np.ndarray]]
) -> None:
    dim, bright = np.full((4, 4), 4000, np.uint16), np.full((4, 4), 60000, np.uint16)
    assert [int(image[0, 0]) for image in door(write_folder(tmp_path / "dim", [dim, dim]))] == [250, 250]
    assert [int(image[0, 0]) for image in door(write_folder(tmp_path / "both", [dim, bright]))] == [15, 234]
