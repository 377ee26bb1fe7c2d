"""Poses and scales of views: from DICOM headers, from a board that two cameras see, and from the catheter's tip."""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._system.json_files import read_small_text
from ..calibration import (
    PRINT_STD_SHARE,
    BoardSettings,
    Quantity,
    RelativePose,
    StatedPose,
    TipPairs,
    calibrate_beads,
    calibrate_board_pair,
    read_tip_pairs,
    refine_relative_pose,
    relative_covariance,
)
from ..errors import FileFormatError, InputError
from ..geometry import CameraModel
from ..io import ASSUMED_SHIFT_M, ASSUMED_TURN_DEG, FilesOfViews, FileSource, RecordingReader, open_source
from ..types import FloatArray, Frame, Image, SessionInfo, ViewInfo, ordered_views

_Three = tuple[float, float, float]
_TURNS = ("about the image's right", "about the image's down", "about the viewing direction")
_SHIFTS = ("along the image's right", "along the image's down", "along the viewing direction")
BEAD_COLUMNS = ("view", "u_px", "v_px", "x_mm", "y_mm", "z_mm")
"""Columns of a table of beads: pixel, and position in the phantom's frame."""
_MIN_SCALE_SHARE = 1e-4
"""Smallest relative uncertainty of a scale that is written: exact beads would give 0, which no file may state."""
_EXACT = (0.0, 0.0, 0.0)
"""Uncertainties of the first view of a pair, to which the pose of the second one is relative."""
MAX_BOARD_FRAMES = 30
"""Largest number of pairs of frames of two videos of a board; they are spread over the videos."""


@dataclass(frozen=True, slots=True)
class CalibratedViews:
    """Poses and scales that were found.

    Attributes:
        views: name -> values that are written into ``bench.toml``.
        quantities: rows of the table.
        remarks: sentences on the values, found or not.
    """

    views: dict[str, ViewInfo]
    quantities: tuple[Quantity, ...]
    remarks: tuple[str, ...]


def views_from_dicom(paths: Sequence[Path], info: SessionInfo) -> CalibratedViews:
    """Reads pose and scale of one view, or of two, from the headers of DICOM files.

    Args:
        paths: the files, one for each view.
        info: metadata, whose views name those of the files.

    Raises:
        FileFormatError: a file cannot be read.
        InputError: there are more than two files, the view of a file is not known, or no header states a geometry.
    """
    if len(paths) > 2:
        raise InputError(f"{paths[2]}: one view or two are calibrated from DICOM at a time, got {len(paths)} files")
    named = SessionInfo(views={name: ViewInfo() for name in info.views})
    source = FilesOfViews(paths, named) if len(paths) == 2 else FileSource(paths[0], {}, named)
    views = {name: source.session_info.view(name) for name in source.views}
    if all(view.metres_per_px is None for view in views.values()):
        raise InputError(" ".join(source.remarks) or f"{paths[0]}: its header states no geometry of an X-ray view")
    quantities = [
        Quantity(
            f"scale of {name}, at the isocentre",
            view.metres_per_px,
            view.metres_per_px * (view.metres_per_px_uncertainty or math.nan),
            "m/px",
            1,
            before=info.view(name).metres_per_px,
        )
        for name, view in views.items()
        if view.metres_per_px is not None
    ]
    return CalibratedViews(views, tuple(quantities), source.remarks)


def views_from_boards(boards: Sequence[Path], settings: BoardSettings, info: SessionInfo) -> CalibratedViews:
    """Finds poses and scales of two cameras from images of a board that they took at the same instants.

    Args:
        boards: a folder of images or a video for each view, whose names end in those of the views; the images of both
            pair up in their order.
        settings: the board.
        info: metadata, whose views name those of the boards.

    Raises:
        FileFormatError: an image cannot be read.
        InputError: the numbers of images differ, or see `calibrate_board_pair`.
    """
    named = SessionInfo(views={name: ViewInfo() for name in info.views})
    names = FilesOfViews(boards, named).views
    images = [_images(board) for board in boards]
    if len(images[0]) != len(images[1]):
        raise InputError(
            f"{boards[0]} has {len(images[0])} images of the board and {boards[1]} has {len(images[1])}: leave in both "
            "those that were taken at the same instants, in the same order"
        )
    pair = calibrate_board_pair(list(zip(*images, strict=True)), settings)
    uncertainties = (_EXACT, _EXACT), _uncertainties(pair.stds)
    views: dict[str, ViewInfo] = {}
    quantities: list[Quantity] = []
    for k, (name, camera) in enumerate(zip(names, pair.cameras, strict=True)):
        scale = pair.scales_m_per_px[k]
        # relative error of the scale: of the printed board, and of the camera's distance
        share = math.hypot(PRINT_STD_SHARE, pair.stds[5] / camera.camera_from_world.translation_m[2])
        views[name] = replace(_at_board(camera, scale, share, uncertainties[k]), modality="camera")
        before = info.view(name).metres_per_px
        quantities.append(Quantity(f"scale of {name}, at the board", scale, scale * share, "m/px", 1, before=before))
    quantities += [
        Quantity(f"pose of {names[1]}, {text}", 0.0, std, unit, pair.images)
        for text, std, unit in zip(
            (*_TURNS, *_SHIFTS), (*np.degrees(pair.stds[:3]), *1e3 * pair.stds[3:]), ("deg",) * 3 + ("mm",) * 3,
            strict=True,
        )
    ]  # fmt: skip
    lens = max(_lens_px(camera, images[k][0]) for k, camera in enumerate(pair.cameras))
    return CalibratedViews(
        views,
        tuple(quantities),
        (
            (
                f"{pair.images} pairs of images show the board to both cameras, residual {pair.residual_px:.2f} px; "
                f"the pose of {names[1]} is relative to {names[0]}"
            ),
            f"the lenses move pixels by up to {lens:.1f} px at the image's edge; detection does not undo it",
        ),
    )


def views_from_beads(table: Path, info: SessionInfo) -> CalibratedViews:
    """Finds poses and scales of views from the marked beads of a phantom.

    Args:
        table: a table (CSV) with the columns of `BEAD_COLUMNS`, one row for a bead in a view.
        info: metadata, for the values before.

    Raises:
        FileFormatError: the table cannot be read.
        InputError: a column is missing, or see `calibrate_beads`.
    """
    rows = _bead_rows(table)
    views: dict[str, ViewInfo] = {}
    quantities: list[Quantity] = []
    remarks: list[str] = []
    for name in ordered_views(rows):
        beads = np.array(rows[name])
        result = calibrate_beads(1e-3 * beads[:, 2:], beads[:, :2], f"{table}, view {name}")
        distance_m = float(result.camera.camera_from_world.translation_m[2])
        scale, share = distance_m / float(result.camera.focal_px[1]), float(result.stds[5]) / distance_m
        views[name] = _at_board(result.camera, scale, max(_MIN_SCALE_SHARE, share), _uncertainties(result.stds))
        before = info.view(name).metres_per_px
        quantities.append(Quantity(f"scale of {name}, at the phantom", scale, scale * share, "m/px", 1, before=before))
        remarks.append(f"view {name}: {result.beads} beads fit to {result.residual_px:.2f} px")
    return CalibratedViews(views, tuple(quantities), tuple(remarks))


def _at_board(
    camera: CameraModel, scale_m_per_px: float, share: float, uncertainties: tuple[_Three, _Three]
) -> ViewInfo:
    """Returns the metadata of a view whose pose is relative to a board or a phantom.

    Args:
        camera: its camera.
        scale_m_per_px: scale at the board.
        share: relative standard uncertainty of the scale.
        uncertainties: standard deviations of turn in degrees and of shift in m, three each.
    """
    return ViewInfo(
        float(f"{scale_m_per_px:.5g}"),
        metres_per_px_uncertainty=float(f"{share:.2g}"),
        projection=camera.projection,
        projection_frame="board",
        pose_uncertainty_deg=uncertainties[0],
        pose_uncertainty_m=uncertainties[1],
    )


def _bead_rows(table: Path) -> dict[str, list[list[float]]]:
    """Returns view -> rows of u, v in px and x, y, z in mm."""
    try:
        lines = list(csv.DictReader(read_small_text(table).splitlines()))
    except (OSError, ValueError, csv.Error) as error:
        raise FileFormatError(f"{table}: cannot be read as a table of beads ({error})") from None
    rows: dict[str, list[list[float]]] = {}
    for number, line in enumerate(lines, start=2):
        try:
            rows.setdefault(line["view"].strip(), []).append([float(line[name]) for name in BEAD_COLUMNS[1:]])
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError(
                f"{table}, line {number}: expected the columns {','.join(BEAD_COLUMNS)}, a name and five numbers"
            ) from None
    if not rows:
        raise InputError(f"{table}: has no row; expected the columns {','.join(BEAD_COLUMNS)}")
    return rows


def views_from_tips(
    recordings: Sequence[Path], info: SessionInfo, progress: Callable[[float], None]
) -> CalibratedViews:
    """Refines the pose of the second view of recordings so that the tips of both views fit.

    Args:
        recordings: recordings with two views in the same poses.
        info: metadata in place of the recordings' own.
        progress: called with the share that is done.

    Raises:
        FileFormatError: a recording cannot be read.
        InputError: a recording has not two views, their poses are not stated, or the tip is detected too rarely.
    """
    # the first recording sets views and stated poses; all others must have the same views
    with RecordingReader(recordings[0]) as reader:
        names, stated = ordered_views(reader.views), reader.session_info.updated(info)
    if len(names) != 2:
        raise InputError(
            f"{recordings[0]}: view_poses=True needs a recording of two views, and this one has {len(names)}"
        )
    first, second = names
    cameras, stds, assumed = _stated_cameras(recordings[0], stated, names)
    parts: list[TipPairs] = []
    for k, path in enumerate(recordings):
        with RecordingReader(path) as reader:
            if ordered_views(reader.views) != names:
                raise InputError(f"{path}: has other views than {recordings[0]}, which has {first} and {second}")
            path_info = reader.session_info.updated(info)
        parts.append(read_tip_pairs(path, names, path_info, lambda share, k=k: progress((k + share) / len(recordings))))
    tips = TipPairs(np.concatenate([part.tips_px for part in parts]), np.concatenate([part.axes for part in parts]))
    refined = refine_relative_pose(StatedPose(cameras, relative_covariance(cameras, stds)), tips)
    stated_stds = np.sqrt(np.diag(relative_covariance(cameras, stds)))
    quantities = [
        Quantity(
            f"{'turn' if k < 3 else 'shift'} of {second} {text}",
            scale * float(refined.change[k]),
            scale * math.sqrt(float(refined.covariance[k, k])),
            unit,
            refined.frames,
            doubt=""
            if refined.resolved[k] > 0.5
            else f"not determined beyond the stated value: +- {scale * stated_stds[k]:.2g} stated",
        )
        for k, (text, scale, unit) in enumerate(
            zip((*_TURNS, *_SHIFTS), (*(180.0 / math.pi,) * 3, *(1e3,) * 3), ("deg",) * 3 + ("mm",) * 3, strict=True)
        )
    ]
    remarks = [_verdict(refined, names)]
    if assumed:
        remarks.append(
            f"views.{second}.pose_uncertainty_deg or pose_uncertainty_m is not stated: that of a C-arm is assumed, "
            f"{ASSUMED_TURN_DEG[0]:g} degree and {1e3 * ASSUMED_SHIFT_M[0]:g} mm"
        )
    if not refined.determined:
        return CalibratedViews({}, tuple(quantities), tuple(remarks))
    frame = stated.view(second).projection_frame
    turn_deg, shift_m = _uncertainties(np.sqrt(np.diag(refined.covariance)))
    views = {
        first: ViewInfo(pose_uncertainty_deg=_EXACT, pose_uncertainty_m=_EXACT),
        second: ViewInfo(
            projection=refined.camera.projection,
            projection_frame=frame,
            pose_uncertainty_deg=turn_deg,
            pose_uncertainty_m=shift_m,
        ),
    }
    return CalibratedViews(views, tuple(quantities), tuple(remarks))


def _verdict(refined: RelativePose, names: tuple[str, ...]) -> str:
    """Returns the sentence on whether the tips fit the stated pose."""
    off = f"{refined.rms_before_px:.1f} px off their epipolar lines, {refined.rms_px:.1f} px with the refined pose"
    if not refined.determined:
        return f"the tip moves too little to determine the pose of {names[1]}, which stays as stated; tips are {off}"
    test = f"chi-square {refined.chi_square:.1f} with {refined.determined} directions, p = {refined.p_value:.2g}"
    if refined.differs:
        return (
            f"the catheter and the stated pose of {names[1]} relative to {names[0]} differ ({test}): tips are {off}; "
            "check the angles, and which file is which view. The standard deviations are widened"
        )
    return f"the catheter agrees with the stated pose of {names[1]} relative to {names[0]} ({test}); tips are {off}"


def _stated_cameras(
    path: Path, info: SessionInfo, names: tuple[str, ...]
) -> tuple[tuple[CameraModel, CameraModel], tuple[FloatArray, FloatArray], bool]:
    """Returns the stated cameras of two views, with the uncertainties of their poses.

    Args:
        path: the recording, for messages.
        info: its metadata.
        names: names of the two views.

    Returns:
        The cameras; (6,) standard deviations of each pose, rad and m; and whether any of these is assumed, because
        neither view states it.

    Raises:
        InputError: a pose is missing or not plausible, or the poses are not in the same frame.
    """
    cameras: list[CameraModel] = []
    stds: list[FloatArray] = []
    frames = {info.view(name).projection_frame for name in names}
    for name in names:
        view = info.view(name)
        if view.projection is None:
            raise InputError(
                f"{path}: views.{name}.projection is not stated; import both planes from DICOM, or find it with "
                "`tipforce calibrate --board A --board B`"
            )
        try:
            cameras.append(CameraModel.from_projection(view.projection))
        except ValueError as error:
            raise InputError(f"{path}: views.{name}.{error}") from None
        turn, shift = view.pose_uncertainty_deg or (0.0,) * 3, view.pose_uncertainty_m or (0.0,) * 3
        stds.append(np.array([*np.radians(turn), *shift]))
    if len(frames) > 1:
        raise InputError(f"{path}: the views state different values of projection_frame; state both poses in one frame")
    missing = (stds[0] + stds[1]) == 0
    defaults = np.array([*np.radians(ASSUMED_TURN_DEG), *ASSUMED_SHIFT_M])
    first, second = (np.where(missing, defaults, each) for each in stds)
    return (cameras[0], cameras[1]), (first, second), bool(missing.any())


def _uncertainties(stds: FloatArray) -> tuple[_Three, _Three]:
    """Returns turn in degrees and shift in m, with three digits, of (6,) standard deviations in rad and m."""
    turn_x, turn_y, turn_z, x, y, z = (float(f"{std:.3g}") for std in (*np.degrees(stds[:3]), *stds[3:]))
    return (turn_x, turn_y, turn_z), (x, y, z)


def _images(board: Path) -> list[Image]:
    """Returns the images of a folder or a video; at most `MAX_BOARD_FRAMES` of them, spread evenly."""
    with open_source(board) as source:
        images = [event.image for event in source if isinstance(event, Frame)]
    step = -(-len(images) // MAX_BOARD_FRAMES) or 1
    return images[::step]


def _lens_px(camera: CameraModel, image: Image) -> float:
    """Returns by how much the lens moves the pixels at the edge of an image."""
    height, width = image.shape[:2]
    edge = np.array([[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0]])
    return float(np.nanmax(np.linalg.norm(camera.undistort(edge) - edge, axis=1)))
