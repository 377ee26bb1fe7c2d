"""Calibrates a bench from recordings and images of a board, and writes the result into its ``bench.toml``."""

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

from ..calibration import (
    BoardResult,
    BoardSettings,
    Calibration,
    Quantity,
    calibrate_board,
    calibrate_sessions,
    read_session,
    scale_from_diameter,
    scale_from_ruler,
    scale_from_shaft,
)
from ..errors import InputError
from ..estimators import no_progress
from ..estimators.session import ForceLimits
from ..io import RecordingReader, is_dicom, is_image, read_image
from ..types import DEFAULT_VIEW, SessionInfo, ViewInfo, bench_text, edited_bench, ordered_views
from ._calibrate_views import CalibratedViews, views_from_beads, views_from_boards, views_from_dicom, views_from_tips
from ._estimate import session_info_from
from ._limits import limits_calibrated

READING_SHARE = 0.9
"""Share of the progress for reading the recordings, which takes longest."""

_UNCERTAINTIES = {
    "bending_stiffness_nm2": "bending_stiffness_uncertainty", "metres_per_px": "metres_per_px_uncertainty",
}  # fmt: skip
"""Key of a value -> key of its relative standard uncertainty, in the same section of ``bench.toml``."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrateReport:
    """Result of a calibration.

    Attributes:
        quantities: rows of the table.
        remarks: sentences on quantities that stay unknown.
        info: the metadata that were used.
        calibration: constants fitted to recordings; None without recordings.
        board: calibration of the lens; None without a board.
        views: poses and scales of views that are written.
        sources: names of the files.
        limits: unknowns that limit the force in the recordings with the found values; None without recordings.
    """

    quantities: tuple[Quantity, ...]
    remarks: tuple[str, ...]
    info: SessionInfo
    calibration: Calibration | None
    board: BoardResult | None
    views: Mapping[str, ViewInfo]
    sources: tuple[str, ...]
    limits: ForceLimits | None = None

    @property
    def calibrated_info(self) -> SessionInfo:
        """Session metadata with the found values."""
        return SessionInfo.from_values(tomllib.loads(self.bench_text()))

    @property
    def written_keys(self) -> tuple[str, ...]:
        """Keys of ``bench.toml`` that are written."""
        return (*(quantity.key for quantity in self.changes), *SessionInfo(views=self.views).stated_keys())

    @property
    def changes(self) -> tuple[Quantity, ...]:
        """Quantities that are good enough to be written."""
        return tuple(quantity for quantity in self.quantities if quantity.key and quantity.written and quantity.known)

    def bench_text(self, text: str | None = None, where: str = "bench.toml") -> str:
        """Returns the text of a ``bench.toml`` with the found values, each with a comment.

        Args:
            text: the text that is changed; None: that of the recordings' metadata.
            where: its file, for messages.

        Raises:
            InputError: ``text`` cannot be edited.
        """
        source = ", ".join(self.sources[:3]) + (f" and {len(self.sources) - 3} more" if len(self.sources) > 3 else "")
        origin = f"tipforce calibrate, {date.today().isoformat()}, {source}"
        values: dict[str, tuple[Any, str]] = {}  # key -> value and comment
        for quantity in self.changes:
            scale = 0.01 if quantity.unit == "%" else 1.0  # the file has shares
            value = quantity.stated if quantity.stated is not None else _rounded(quantity.value, quantity.std)
            values[quantity.key] = (value, f"+- {scale * quantity.std:.2g}; {origin}")
            section, _, name = quantity.key.rpartition(".")
            if name in _UNCERTAINTIES and 0.0 < quantity.std < abs(quantity.value):
                relative = float(f"{quantity.std / abs(quantity.value):.3g}")
                values[f"{section}.{_UNCERTAINTIES[name]}"] = (relative, f"of {name}, relative")
        for name, view in SessionInfo(views=self.views).values().get("views", {}).items():
            values |= {f"views.{name}.{key}": (value, origin) for key, value in view.items()}
        if text is None:
            # a view must have a section, into which its values are written
            views = {name: self.info.view(name) for name in self.views} | dict(self.info.views)
            text = bench_text(replace(self.info, name="", views=views))
        return edited_bench(text, values, where)

    def figures(self) -> dict[str, Any]:
        """Returns the report as JSON values."""
        return {
            "quantities": [each.figures() for each in self.quantities],
            "remarks": list(self.remarks),
            "board": None if self.board is None else self.board.figures(),
            "views": SessionInfo(views=self.views).values().get("views", {}),
            "sources": list(self.sources),
            "limits": None if self.limits is None else self.limits.figures(),
        }


def calibrate(
    recordings: Path | str | Sequence[Path | str] = (),
    *,
    bench: SessionInfo | Path | str | None = None,
    contact_free: bool = False,
    seconds: float = math.inf,
    stated_within: float = 0.1,
    board: Path | str | Sequence[Path | str] | None = None,
    board_settings: BoardSettings | None = None,
    ruler: tuple[float, float, float, float, float] | None = None,
    view: str = DEFAULT_VIEW,
    view_poses: bool = False,
    by_diameter: bool = False,
    beads: Path | str | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> CalibrateReport:
    """Calibrates a bench from recordings, a board or a ruler, or the poses of its views.

    Args:
        recordings: .mcap files, or a folder of them; of one bench and one catheter. Or DICOM files, one for each view,
            for the views' poses and scales alone.
        bench: metadata in place of the recordings' own.
        contact_free: the tip touches nothing in any of them, and no force is needed.
        seconds: length of the beginning of each recording that is used.
        stated_within: standard deviation of the stated stiffness, relative.
        board: images of a ChArUco board, the first in the plane in which the catheter bends, or a folder of them; or
            two folders or videos, one for each of two cameras, for their poses.
        board_settings: settings of the board.
        ruler: u0, v0, u1, v1 in px, and their distance in mm.
        view: the view whose scale board and ruler give.
        view_poses: only the pose of the second view of the recordings is refined, from the catheter's tip.
        by_diameter: only the scales of the views of a recording are found, from the stated diameter of the shaft.
        beads: a table of the marked beads of a phantom, for the poses of the views in it.
        progress: called with the current step and the share that is done.

    Returns:
        The table, and the values that can be written into ``bench.toml``.

    Raises:
        FileFormatError: a file cannot be read.
        InputError: there is nothing to calibrate from, or the input is not sufficient.
    """
    report = progress or no_progress
    inputs = _paths(recordings)
    info = session_info_from(bench)
    boards = [] if board is None else _paths(board)
    dicom = [path for path in inputs if is_dicom(path)]
    pair = len(boards) == 2 and not any(is_image(path) for path in boards)
    # Views alone are calibrated in one of five ways. None of them goes together with another, or with the bench's ways.
    view_ways = {
        "DICOM": bool(dicom),
        "a pair of boards": pair,
        "view_poses=True": view_poses,
        "by_diameter=True": by_diameter,
        "beads": beads is not None,
    }
    bench_ways = {
        "recordings": len(inputs) > len(dicom) and not (view_poses or by_diameter),
        "a board": bool(boards) and not pair,
        "a ruler": ruler is not None,
        "contact_free=True": contact_free,
    }
    chosen = [way for way, wanted in view_ways.items() if wanted]
    if chosen and (excess := [*chosen[1:], *(way for way, wanted in bench_ways.items() if wanted)]):
        raise InputError(
            f"calibrate: {chosen[0]} is one way to calibrate views, without the bench; leave out {', '.join(excess)}, "
            "and calibrate from that in a second command"
        )
    if dicom:
        return _views_report(views_from_dicom(inputs, info), info, inputs)
    if beads is not None:
        return _views_report(views_from_beads(Path(beads), info), info, [Path(beads)])
    if pair:
        return _views_report(views_from_boards(boards, board_settings or BoardSettings(), info), info, boards)
    paths = [path for each in inputs for path in _recordings(each)]
    if view_poses:
        if not paths:
            raise InputError("view_poses=True: name a recording of two views")
        refined = views_from_tips(paths, info, lambda share: report("detecting the tip", share))
        return _views_report(refined, info, paths)
    if by_diameter:
        if not paths:
            raise InputError("by_diameter=True: name a recording")
        return _scales_report(paths[0], info)
    # the scale of a view comes first: the recordings are read with it
    quantities: list[Quantity] = []
    board_result: BoardResult | None = None
    sources = [path.name for path in paths]
    if boards:
        files = _images(boards)
        board_result = calibrate_board([read_image(path) for path in files], board_settings or BoardSettings())
        quantities.append(_scale(board_result.quantity, view, info))
        sources.append(files[0].name)
    if ruler is not None:  # with a board it is only shown beside it: the board is more accurate
        by_ruler = _scale(scale_from_ruler(ruler[:4], ruler[4]), view, info)
        quantities.append(replace(by_ruler, written=board_result is None))
        sources.append("ruler")
    if not (paths or quantities):
        raise InputError("recordings, board and ruler are all missing: name at least one to calibrate from")
    lens_remarks = _lens_remarks(board_result)
    if not paths:
        return CalibrateReport(tuple(quantities), lens_remarks, info, None, board_result, {}, tuple(sources))
    if quantities:
        info = info.updated(SessionInfo(views={view: ViewInfo(metres_per_px=quantities[0].value)}))
    sessions = []
    for k, path in enumerate(paths):

        def share(part: float, k: int = k, path: Path = path) -> None:
            report(f"reading {path.name}", READING_SHARE * (k + part) / len(paths))

        sessions.append(read_session(path, bench=info, seconds=seconds, contact_free=contact_free, progress=share))
    calibration = calibrate_sessions(
        sessions,
        stated_within=stated_within,
        rest_shape=contact_free,
        progress=lambda part: report("fitting", READING_SHARE + (1.0 - READING_SHARE) * part),
    )
    by_shaft = scale_from_diameter(sessions)
    quantities += [] if by_shaft is None else [by_shaft]
    result = CalibrateReport(
        quantities=(*quantities, *calibration.quantities),
        remarks=(*lens_remarks, *calibration.remarks),
        info=sessions[0].info,
        calibration=calibration,
        board=board_result,
        views={},
        sources=tuple(sources),
    )
    return replace(result, limits=limits_calibrated(sessions, result.calibrated_info))


def _paths(paths: Path | str | Sequence[Path | str]) -> list[Path]:
    return [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]


def _views_report(found: CalibratedViews, info: SessionInfo, sources: Sequence[Path]) -> CalibrateReport:
    names = tuple(path.name for path in sources)
    return CalibrateReport(found.quantities, found.remarks, info, None, None, found.views, names)


def _scales_report(path: Path, info: SessionInfo) -> CalibrateReport:
    """Returns the scale of each view of a recording, from the stated diameter of the shaft."""
    with RecordingReader(path) as reader:
        updated_info = reader.session_info.updated(info)
        views = ordered_views(reader.views)
    scales = tuple(scale_from_shaft(path, view, updated_info) for view in views)
    remark = "blur and shadow move the flanks of the shaft: better, measure the scale with a ruler or a board"
    return CalibrateReport(scales, (remark,), updated_info, None, None, {}, (path.name,))


def _recordings(path: Path) -> list[Path]:
    """Returns the recordings of the folder ``path``, or ``path`` itself where it is a recording.

    Raises:
        InputError: the folder holds no recording, or the file is no recording.
    """
    if path.is_dir():
        recordings = sorted(path.glob("*.mcap"))
        if not recordings:
            raise InputError(f"{path}: holds no recording (.mcap); make one with `tipforce import`")
        return recordings
    if path.suffix != ".mcap":
        raise InputError(f"{path}: is no recording (.mcap); make one of video and logs with `tipforce import`")
    return [path]


def _images(paths: Sequence[Path]) -> list[Path]:
    """Returns the image files among ``paths`` and in the folders among them.

    Raises:
        InputError: no image is found.
    """
    files: list[Path] = []
    for path in paths:
        files += sorted(file for file in path.iterdir() if is_image(file)) if path.is_dir() else [path]
    if not files:
        raise InputError(f"board: {paths[0]} holds no image")
    return files


def _scale(quantity: Quantity, view: str, info: SessionInfo) -> Quantity:
    return replace(quantity, key=f"views.{view}.metres_per_px", before=info.view(view).metres_per_px)


def _lens_remarks(board: BoardResult | None) -> tuple[str, ...]:
    """Returns the remark on the distortion of the lens, or on images that are missing for it; none without a board."""
    if board is None:
        return ()
    if board.distortion is None:
        return (
            f"{board.images} image(s) of the board do not determine the lens: add five, tilted in different directions",
        )
    return (f"the lens moves pixels by up to {board.lens_px:.1f} px at the image's edge; detection does not undo it",)


def _rounded(value: float, std: float) -> float:
    """Rounds ``value`` to a tenth of its standard deviation or finer; as it is where the deviation is not known."""
    if not (math.isfinite(std) and std > 0.0 and value):
        return value
    digits = max(1, math.ceil(math.log10(abs(value) / std)) + 2)
    return float(f"{value:.{digits}g}")


def _shown(value: float | None, std: float) -> str:
    if value is None:
        return "-"
    if math.isnan(value):
        return "?"
    return f"{_rounded(value, std):g}"


def describe_calibration(report: CalibrateReport) -> list[str]:
    """Returns a table, one line a quantity, then the remarks, and the unknown that limits the force from now on."""
    rows = [("quantity", "value", "+-", "", "before", "doubt")]
    for quantity in report.quantities:
        value, std = _shown(quantity.value, quantity.std), f"{quantity.std:.2g}" if math.isfinite(quantity.std) else "?"
        mark = quantity.doubt or ("" if quantity.written or not quantity.key else "kept as stated")
        rows.append((quantity.name, value, std, quantity.unit, _shown(quantity.before, 0.0), mark))
    # all columns but the last are padded: names and units on the right, numbers on the left
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    justify = (str.ljust, str.rjust, str.rjust, str.ljust, str.rjust)
    cells = [[pad(cell, width) for pad, cell, width in zip(justify, row[:5], widths, strict=True)] for row in rows]
    lines = ["  ".join((*padded, row[5])).rstrip() for padded, row in zip(cells, rows, strict=True)]
    remarks = list(report.remarks)
    if report.limits is not None and report.limits.measurable:
        remarks.append(f"with these values the force is limited by {report.limits.text()}")
    return [*lines, "", *remarks] if remarks else lines


def plot_calibration(report: CalibrateReport, path: Path | str) -> None:
    """Plots the map of the knob, the forces of sensor and rod, and the tissue's law.

    Args:
        report: the report of a calibration from recordings.
        path: the file, .png or .svg.

    Raises:
        InputError: the report has no recordings.
        FileFormatError: the name ends otherwise.
        OutputError: nothing can be written in the folder.
    """
    from ._calibrate_plot import draw_calibration  # matplotlib takes a third of a second to load

    if report.calibration is None:
        raise InputError("plot: without recordings there is nothing to draw")
    draw_calibration(report.calibration, Path(path))
