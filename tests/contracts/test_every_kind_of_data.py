"""What can be trained on can be estimated on: every kind of data is a source of the same frames."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import dataset_at, open_dataset, open_source
from tipforce.errors import InputError
from tipforce.io import RecordingWriter, frame_count, require_actuation
from tipforce.types import Actuation, Frame, SensorInfo, SessionInfo, Wrench

COUNT = 5


def images() -> list[np.ndarray]:
    return [np.full((12, 16), 40 + k, np.uint8) for k in range(COUNT)]


def folder(path: Path) -> Path:
    path.mkdir()
    rows = ["file_name,stamp_ns,knob_deg,fx_n"]
    for k, image in enumerate(images()):
        cv2.imwrite(str(path / f"{k}.png"), image)
        rows.append(f"{k}.png,{k * 40_000_000},{10 + k},0.{k}")
    (path / "metadata.csv").write_text("\n".join(rows) + "\n")
    return path


def table(path: Path) -> Path:
    return folder(path).joinpath("metadata.csv").rename(path / "labels.csv")


def recording(path: Path) -> Path:
    target = path.with_suffix(".mcap")
    with RecordingWriter(target, SessionInfo("run"), lossless=True) as writer:
        writer.state(SensorInfo(0.0, "tissue-on-tip"))
        for k, image in enumerate(images()):
            writer.write(Actuation(k * 40_000_000, {"knob_deg": 10.0 + k}))
            writer.write(Wrench(k * 40_000_000, np.array([0.1 * k, 0.0, np.nan]), np.full(3, np.nan), "sensor"))
            writer.write(Frame(k * 40_000_000, image))
    return target


def recordings(path: Path) -> Path:
    path.mkdir()
    recording(path / "only")
    return path


def shards(path: Path) -> Path:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    cells = [{"bytes": cv2.imencode(".png", image)[1].tobytes(), "path": ""} for image in images()]
    stamps, knob = [k * 40_000_000 for k in range(COUNT)], [10.0 + k for k in range(COUNT)]
    columns = {"image": cells, "stamp_ns": stamps, "knob_deg": knob, "fx_n": [0.1] * COUNT}
    target = path.with_suffix(".parquet")
    parquet.write_table(arrow.table(columns), target)
    return target


@pytest.mark.parametrize("make", [folder, table, recording, recordings, shards])
def test_what_is_trained_on_is_estimated_on(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    path = make(tmp_path / "data")
    trained = [each.views["camera"] for each in open_dataset(path).observations()]
    with open_source(path) as source:
        require_actuation(source, ["knob_deg"])
        assert frame_count(source) == COUNT
        events = list(source)
    frames = [event for event in events if isinstance(event, Frame)]
    assert [frame.stamp_ns for frame in frames] == [k * 40_000_000 for k in range(COUNT)]
    for frame, image in zip(frames, trained, strict=True):
        np.testing.assert_array_equal(frame.image, image)  # type: ignore[arg-type]
    knob = [event.values["knob_deg"] for event in events if isinstance(event, Actuation)]
    assert knob == [10.0 + k for k in range(COUNT)]
    assert not any(isinstance(event, Wrench) for event in events) or make in (recording, recordings)


def test_of_several_sessions_one_is_stated(tmp_path: Path) -> None:
    path = tmp_path / "data"
    folder(path)
    rows = (path / "metadata.csv").read_text().splitlines()
    named = ["session," + rows[0], *(f"s{k % 2},{row}" for k, row in enumerate(rows[1:]))]
    (path / "metadata.csv").write_text("\n".join(named) + "\n")
    with pytest.raises(InputError, match="holds 2 sessions; state one of them: s0, s1"):
        open_source(path)
    source = open_source(path, session="s1")
    assert [event.stamp_ns for event in source if isinstance(event, Frame)] == [40_000_000, 120_000_000]
    assert source.session_info.name == "s1"
    with pytest.raises(InputError, match="has no session s9: s0, s1"):
        open_source(path, session="s9")
    assert dataset_at(path) is not None


def test_shape_numbers_are_no_images(tmp_path: Path) -> None:
    (tmp_path / "metadata.csv").write_text("shape_A1,fx_n\n0.5,0.25\n1,0.5\n")
    with pytest.raises(InputError, match="holds ready-made shape numbers and no images"):
        list(open_source(tmp_path))


def test_one_image_is_a_source_of_one_frame(tmp_path: Path) -> None:
    shutil.copy(folder(tmp_path / "data") / "3.png", tmp_path / "still.png")
    (frame,) = open_source(tmp_path / "still.png", stated=SessionInfo())
    assert isinstance(frame, Frame)
    assert int(frame.image[0, 0]) == 43
