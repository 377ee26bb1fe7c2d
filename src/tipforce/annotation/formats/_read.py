"""Reads a file of annotations of any of the formats; the format is found from the file."""

from pathlib import Path

from ..._system.json_files import read_json
from ...errors import FileFormatError, TableError
from ._cells import MAX_TABLE_BYTES, read_rows
from ._coco import read_coco
from ._guide3d import read_guide3d
from ._masks import read_masks
from ._tables import OUR_COLUMNS, Marks, read_deeplabcut, read_our_table, read_sleap

_OTHERS = {
    ".slp": "export it in SLEAP with File > Export Analysis CSV",
    ".h5": "DeepLabCut and SLEAP write a .csv with the same content; state that file",
    ".pkl": "DeepLabCut writes a .csv with the same content; state that file",
    ".xml": "export it in CVAT as COCO Keypoints 1.0",
    ".zip": "unpack it, and state the .json or .csv in it",
}
_EXPECTED = "image,u,v (ours), frame_idx and NODE.x (SLEAP), or scorer, bodyparts, coords (DeepLabCut)"


def read_marks(path: Path) -> Marks:
    """Reads the annotations in a file.

    Args:
        path: a CSV of ours, of SLEAP or of DeepLabCut, a JSON with COCO keypoints or of Guide3D, or a folder of masks.

    Returns:
        The frames, with the names that the file gives to its images.

    Raises:
        FileFormatError: the file has another format.
        TableError: a cell cannot be used; the message names file and line.
    """
    if path.is_dir():
        return read_masks(path)
    suffix = path.suffix.lower()
    if suffix in _OTHERS:
        raise FileFormatError(f"{path}: is not read; {_OTHERS[suffix]}")
    if suffix == ".json":
        values = read_json(path, max_bytes=MAX_TABLE_BYTES)
        return read_guide3d(path, values) if isinstance(values, list) and values else read_coco(path, values)
    rows = read_rows(path)
    header = rows[0][1]
    if header[0].lower() == "scorer":
        return read_deeplabcut(path, rows)
    if "frame_idx" in header:
        return read_sleap(path, rows)
    if set(OUR_COLUMNS) <= {name.lower() for name in header}:
        return read_our_table(path, rows)
    shown = ", ".join(header[:6])[:200]
    raise TableError(f"{path}, line {rows[0][0]}: the header is {shown}; expected {_EXPECTED}")
