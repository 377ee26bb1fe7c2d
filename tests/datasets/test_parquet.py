"""Parquet shards: read like any dataset, a row group at a time; refused with a reason."""

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.errors import FileFormatError, MissingExtraError, TableError

pa: Any = pytest.importorskip("pyarrow")
pq: Any = pytest.importorskip("pyarrow.parquet")

PNG = cv2.imencode(".png", np.full((1, 1), 255, np.uint8))[1].tobytes()


def shard(path: Path, rows: int = 6, start: int = 0, **change: Any) -> Path:
    columns: dict[str, Any] = {
        "image": [{"bytes": PNG, "path": None}] * rows,
        "session": ["one"] * rows,
        "stamp_ns": [start + k for k in range(rows)],
        "knob_deg": [None, *[1.5] * (rows - 1)],
        "fx_n": [0.1 * k for k in range(rows)],
        **change,
    }
    pq.write_table(pa.table({name: cells for name, cells in columns.items() if cells is not None}), path,
                   row_group_size=2)  # fmt: skip
    return path


def test_shards_of_others_open_in_the_order_of_their_names(tmp_path: Path) -> None:
    shard(tmp_path / "train-00001.parquet", start=100)
    shard(tmp_path / "train-00000.parquet")
    data = open_dataset(tmp_path)
    assert (len(data), data.title, data.known.tolist()) == (12, tmp_path.name, [True, False, False])
    assert data.names[7] == "train-00001.parquet row 1"
    first, second = list(data.subset(np.array([0, 8])).observations())
    assert (dict(first.actuation), dict(second.actuation)) == ({}, {"knob_deg": 1.5})
    assert second.views["camera"].shape == (1, 1)  # type: ignore[union-attr]
    assert len(open_dataset(tmp_path / "train-00001.parquet")) == 6


def test_images_are_read_one_row_group_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = open_dataset(shard(tmp_path / "a.parquet"))
    read: list[int] = []
    real = pq.ParquetFile.read_row_group
    monkeypatch.setattr(
        pq.ParquetFile, "read_row_group", lambda self, i, **how: (read.append(i), real(self, i, **how))[1]
    )
    observations = data.observations()
    next(observations)
    assert read == [0]
    list(observations)
    assert read == [0, 1, 2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"knob_deg": [float("inf"), *[1.5] * 5]}, r"a\.parquet row 0, column knob_deg: expected a finite number"),
        ({"fx_n": [0.1, None, 0.3, 0.4, 0.5, 0.6]}, r"a\.parquet row 1, column fx_n: expected a finite number"),
        ({"fx_n": ["a"] * 6}, r"column fx_n: expected numbers, got string"),
        ({"stamp_ns": [0.5] * 6}, r"column stamp_ns: expected whole numbers"),
        ({"fx_n": None}, r"has no force column"),
        ({"image": None}, r"has no column of images"),
        ({"session": [""] * 6}, r"a\.parquet row 0, column session: is empty"),
        ({"speed": [1.0] * 6}, r"'speed' does not state its unit"),
    ],
)
def test_a_shard_that_cannot_be_used_is_one_clear_sentence(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(TableError, match=message):
        open_dataset(shard(tmp_path / "a.parquet", **change))


def test_shards_of_different_columns_are_refused(tmp_path: Path) -> None:
    shard(tmp_path / "a.parquet")
    shard(tmp_path / "b.parquet", fy_n=[0.0] * 6)
    with pytest.raises(TableError, match=r"b\.parquet: has the columns .* but a\.parquet has"):
        open_dataset(tmp_path)


def test_a_damaged_shard_names_its_file(tmp_path: Path) -> None:
    path = shard(tmp_path / "a.parquet")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=r"a\.parquet: is no readable Parquet file"):
        open_dataset(path)
    data = open_dataset(shard(tmp_path / "b.parquet", image=[{"bytes": b"no", "path": "x.png"}] * 6))
    with pytest.raises(FileFormatError, match=r"b\.parquet, row 0: the image is missing, empty or damaged"):
        next(data.observations())


def test_without_pyarrow_the_install_line_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shard(tmp_path / "a.parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[parquet\]'"):
        open_dataset(tmp_path)
