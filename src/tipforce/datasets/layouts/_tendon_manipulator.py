"""github.com/Bigyuun/LSTM-force-estimation: a planar manipulator with two tendons, polynomials of its centreline.

``sessions/data_NAME.csv`` has one row per frame, ``sessions/curve_fit_result-poly4d_NAME.json`` the polynomial of each
frame, of degree 4 without constant term, in an undocumented unit of length. The forces are integers of an undocumented
unit, plausibly millinewtons, along the sensor's own axes and with a bias that differs by session.
"""

from pathlib import Path

import numpy as np

from ..._system.json_files import read_json
from ...errors import FileFormatError, InputError, TableError
from ...io import open_table
from ...types import Catheter, FloatArray, SessionInfo
from .._dataset import Dataset
from .._label_table import check_stamps
from .._stores import ShapeTable

TARE_ROWS = 10
"""Number of first rows of a session whose median is subtracted (tare)."""

SHAPE_NAMES = ("A1", "A2", "A3", "A4")
NEWTONS_PER_UNIT = 1e-3
REMARKS = (
    "github.com/Bigyuun/LSTM-force-estimation, commit 621b92c9; the unit of the forces is undocumented there and taken "
    f"as millinewtons; tared by the median of the first {TARE_ROWS} rows"
)
CATHETER = Catheter("planar tendon manipulator")


def recognises(folder: Path) -> bool:
    """Returns whether ``folder`` contains ``sessions``, or is that folder."""
    return any(any(place.glob("data_*.csv")) and any(place.glob(_CURVES.format("*"))) for place in _places(folder))


def open_layout(folder: Path) -> Dataset:
    """Returns all sessions; raises FileFormatError or TableError if a session is incomplete."""
    tables = next(tables for place in _places(folder) if (tables := sorted(place.glob("data_*.csv"))))
    sessions = [_session(path) for path in tables]
    names, stamps, images, shapes, wires, forces = (list(part) for part in zip(*sessions, strict=True))
    counts = [len(part) for part in stamps]
    stamp_ns, wire = np.concatenate(stamps), np.concatenate(wires)
    actuation = {"wire0_mm": wire[:, 0].copy(), "wire1_mm": wire[:, 1].copy()}
    return Dataset(
        store=ShapeTable(stamp_ns, actuation, SHAPE_NAMES, np.concatenate(shapes)),
        session=np.repeat(names, counts),
        stamp_ns=stamp_ns,
        actuation=actuation,
        force_n=np.concatenate(forces),
        known=np.array([True, True, False]),
        names=np.array([image for part in images for image in part]),
        session_info={name: SessionInfo(name, CATHETER, force_frame="sensor", remarks=REMARKS) for name in names},
        rows=np.arange(len(stamp_ns)),
        title="tendon-manipulator (forces in an undocumented unit, taken as mN)",
    )


_MAX_BYTES = 256 << 20
"""Largest file of curves; the published ones have about 1 MB."""
_REMEDY = "copy the data set again"
_CURVES = "curve_fit_result-poly4d_{}.json"


def _places(folder: Path) -> tuple[Path, Path]:
    return folder / "sessions", folder


def _session(
    path: Path,
) -> tuple[str, np.ndarray[tuple[int], np.dtype[np.int64]], list[str], FloatArray, FloatArray, FloatArray]:
    """Returns name, stamps (n,), image names (n,), coefficients (n, 4), wires (n, 2) in mm, forces (n, 3) in N."""
    name = path.stem.removeprefix("data_")
    table, curves = open_table(path, comments=False), path.with_name(_CURVES.format(name))
    stamps = table.integers("sec") * 1_000_000_000 + table.integers("nanosec")
    if np.any(np.diff(stamps) < 0):
        raise TableError(f"{path}: its rows are not in the order of time")
    check_stamps(str(path), name, stamps)
    if len(table) < TARE_ROWS:
        raise InputError(f"{path}: has {len(table)} rows; the first {TARE_ROWS} are needed to tare it")
    images, coefficients = table.text("image"), _read_curves(curves)
    for row, image in enumerate(images, 2):
        if image not in coefficients:
            raise TableError(f"{path}, row {row}: {curves.name} has no curve of the image {image}")
    readings = np.column_stack([table.numbers("fx"), table.numbers("fy")])
    force = np.full((len(table), 3), np.nan)
    force[:, :2] = (readings - np.median(readings[:TARE_ROWS], axis=0)) * NEWTONS_PER_UNIT
    wires = np.column_stack([table.numbers("wire length #0"), table.numbers("wire length #1")])
    return name, stamps, images, np.array([coefficients[image] for image in images]), wires, force


def _read_curves(path: Path) -> dict[str, list[float]]:
    """Returns image name -> the four coefficients of its curve. Raises FileFormatError."""
    if not path.is_file():
        raise FileFormatError(f"{path}: there is no such file; every session needs its curves")
    try:
        entries = read_json(path, max_bytes=_MAX_BYTES, remedy=_REMEDY)
        curves = {entry["Image Filename"]: [float(value) for value in entry["Coefficients"]] for entry in entries}
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: is no list of curves ({type(error).__name__}: {error}); {_REMEDY}") from None
    for image, values in curves.items():
        if len(values) != len(SHAPE_NAMES) or not np.isfinite(values).all():
            raise FileFormatError(f"{path}: the curve of {image} is {values}, expected {len(SHAPE_NAMES)} numbers")
    return curves
