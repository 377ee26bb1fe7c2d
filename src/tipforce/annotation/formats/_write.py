"""Writes annotations: our table as ``.csv``, COCO keypoints as ``.json``."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...errors import FileFormatError
from ...io import check_output_file, write_atomic
from .._store import MarkedFrame
from ._coco import coco_values
from ._tables import OUR_COLUMNS, TIP_HIDDEN


def check_marks_file(path: Path) -> None:
    """Checks before any work whether annotations can be written as ``path``.

    Raises:
        FileFormatError: the name ends neither in .csv nor in .json.
        OutputError: as `tipforce.io.check_output_file`.
    """
    if path.suffix.lower() not in (".csv", ".json"):
        raise FileFormatError(f"{path}: annotations are written as .csv (image, u, v) or .json (COCO); name it so")
    check_output_file(path)


def write_marks(path: Path, frames: Sequence[MarkedFrame], sizes_px: Mapping[str, tuple[int, int]]) -> None:
    """Writes the finished frames; `read_marks` reads the same lines from the file.

    Args:
        path: file, .csv or .json.
        frames: the finished frames.
        sizes_px: name of each image -> its width and height.

    Raises:
        FileFormatError: as `check_marks_file`.
        OutputError: the file cannot be written.
    """
    check_marks_file(path)
    if path.suffix.lower() == ".json":
        write_atomic(path, json.dumps(coco_values(frames, sizes_px), indent=1, ensure_ascii=False) + "\n")
        return
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*OUR_COLUMNS, TIP_HIDDEN])
    for frame in frames:
        rows = [(f"{u:.3f}", f"{v:.3f}") for u, v in frame.points_px.tolist()] if frame.present else [("", "")]
        last = len(rows) - 1
        table.writerows([frame.image, u, v, int(frame.tip_hidden and k == last)] for k, (u, v) in enumerate(rows))
    write_atomic(path, text.getvalue())
