"""The camera: its scale in the plane in which the catheter bends, and the distortion of that plane by lens and tilt.

Three methods, from the best to the worst: a ChArUco board in the plane of bending; two image points at a known
distance; the shaft, whose diameter is stated. The detection uses the image as it is, with one scale for the whole
image: `BoardResult` states the error by lens and tilt.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..errors import InputError
from ..io import RecordingReader, spread_images
from ..types import Catheter, FloatArray, Image, SessionInfo
from ..vision import SessionDetector, VisionSettings
from ._quantity import Quantity
from ._session import CalibrationSession

MIN_CORNERS, MIN_LENS_IMAGES = 8, 6
"""Least number of corners in an image; least number of images from which the lens is calibrated."""
CLICK_STD_PX = 1.0
"""Standard deviation of a point that a person marks."""
DIAMETER_STD_SHARE = 0.03
"""Relative standard deviation of the shaft's detected diameter: blur, shadow and light move both flanks."""
CAMERA_SHAFT_STD_SHARE, XRAY_SHAFT_STD_SHARE = 0.065, 0.11
"""Relative standard deviations of a scale from the diameter that is detected where neither scale nor diameter is known:
simulated sessions, 7 views of a camera (-6 to +14 %), 7 of `biplane` (-13 to +20 %)."""
MIN_DIAMETERS = 5
"""Least number of images in which the shaft's diameter is detected."""
PRINT_STD_SHARE = 2e-3
"""Relative standard deviation of a printed board's squares."""
MAX_SCALE_RANGE, MAX_TILT_DEG = 0.01, 5.0
FORCE_PER_SCALE = 2.0
"""A relative error of the scale changes the force by at most this factor of it: by the rod's law EI / length^2."""


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """A ChArUco board.

    Attributes:
        squares: number of squares across and down.
        square_m: length of a square.
        marker_m: length of a marker; None: three quarters of a square.
        dictionary: name of the markers' dictionary in OpenCV.
    """

    squares: tuple[int, int] = (7, 5)
    square_m: float = 5e-3
    marker_m: float | None = None
    dictionary: str = "DICT_4X4_50"


@dataclass(frozen=True, slots=True, eq=False)
class BoardResult:
    """Result of a board.

    Attributes:
        metres_per_px: scale in the plane of the board in the first image, at its middle.
        scale_std: standard deviation of the scale.
        tilt_deg: angle between the board's and the image's plane; NaN if the lens is not known.
        worst_px: largest deviation of the image of that plane from a plain scale, within the board's outline.
        scale_range: relative range of the scale over the board.
        focal_px: focal length; NaN if there are too few images.
        distortion: (5,) k1, k2, p1, p2, k3; None if there are too few images.
        lens_px: largest displacement of a pixel by the lens alone.
        residual_px: residual of the corners.
        corners: number of corners that were found in the first image.
        images: number of images in which the board was found.
    """

    metres_per_px: float
    scale_std: float
    tilt_deg: float
    worst_px: float
    scale_range: float
    focal_px: float
    distortion: FloatArray | None
    lens_px: float
    residual_px: float
    corners: int
    images: int

    @property
    def quantity(self) -> Quantity:
        """The scale as a quantity without a key, because only the caller knows the view."""
        remarks: list[str] = []
        if self.scale_range > MAX_SCALE_RANGE:
            remarks.append(
                f"it differs by {self.scale_range:.1%} over the board ({self.worst_px:.1f} px off a plain scale), "
                f"which is up to {FORCE_PER_SCALE * self.scale_range:.1%} of the force; detection does not undistort"
            )
        if self.tilt_deg > MAX_TILT_DEG:
            remarks.append(
                f"the board is tilted by {self.tilt_deg:.0f} deg: look straight down on the plane of bending"
            )
        return Quantity(
            "scale, by the board", self.metres_per_px, self.scale_std, "m/px", self.images, written=True,
            doubt="; ".join(remarks),
        )  # fmt: skip

    def figures(self) -> dict[str, Any]:
        """Returns the values as JSON values."""
        return asdict(self) | {"distortion": None if self.distortion is None else self.distortion.tolist()}


def calibrate_board(images: Sequence[Image], settings: BoardSettings) -> BoardResult:
    """Finds scale, tilt and lens from images of a ChArUco board.

    Args:
        images: in the first one the board is in the plane in which the catheter bends; five or more further ones, with
            the board tilted in different directions, determine the lens.
        settings: the board.

    Returns:
        Scale and tilt, and with enough images the lens.

    Raises:
        InputError: the values of the board are not possible, its dictionary is unknown, or the first image shows no
            board.
    """
    detector, board = _detector(settings)
    corner_pairs: list[tuple[FloatArray, FloatArray]] = []
    for k, image in enumerate(images):
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        corners, ids, _, markers = detector.detectBoard(grey)
        count = 0 if ids is None else len(ids)
        if count < MIN_CORNERS:
            if k == 0:
                marker_count = 0 if markers is None else len(markers)
                raise InputError(
                    f"the board shows {count} corners and {marker_count} markers in the first image, {MIN_CORNERS} "
                    "corners are needed: check squares and dictionary of the board"
                )
            continue
        object_points, image_points = board.matchImagePoints(corners, ids)
        corner_pairs.append((object_points.reshape(-1, 3), image_points.reshape(-1, 2)))
    height, width = images[0].shape[:2]
    board_m, pixels = corner_pairs[0][0][:, :2].astype(np.float64), corner_pairs[0][1].astype(np.float64)
    scale, worst, residual, scale_range = _plain_scale(board_m, pixels)
    tilt, focal, lens_px, distortion = math.nan, math.nan, math.nan, None
    if len(corner_pairs) >= MIN_LENS_IMAGES:
        # k2 and k3 need boards in every corner of the image; k1, p1 and p2 describe a typical lens
        rms, matrix, coefficients, turns, _, _, _, _ = cv2.calibrateCameraExtended(
            [points.astype(np.float32) for points, _ in corner_pairs],
            [corners.astype(np.float32) for _, corners in corner_pairs],
            (width, height), np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3,
        )  # fmt: skip
        normal = cv2.Rodrigues(turns[0])[0][:, 2]
        tilt = math.degrees(math.acos(min(1.0, abs(float(normal[2])))))
        focal, residual = float(matrix[0, 0]), float(rms)
        distortion = np.asarray(coefficients, np.float64).ravel()[:5]
        lens_px = _lens_px(matrix, distortion, (width, height))
    std = scale * math.hypot(PRINT_STD_SHARE, residual / max(float(np.ptp(pixels, axis=0).max()), 1.0))
    return BoardResult(
        scale, std, tilt, worst, scale_range, focal, distortion, lens_px, residual, len(pixels), len(corner_pairs)
    )  # fmt: skip


def board_corners(image: Image, settings: BoardSettings) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Finds the corners of a board in an image.

    Args:
        image: (h, w) grey or (h, w, 3) RGB.
        settings: the board.

    Returns:
        Number of the corner -> (3,) its position on the board in m, and (2,) its pixel.

    Raises:
        InputError: the values of the board are not possible, or its dictionary is unknown.
    """
    detector, board = _detector(settings)
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    corners, ids, _, _ = detector.detectBoard(grey)
    if ids is None or len(ids) == 0:
        return {}
    points, pixels = board.matchImagePoints(corners, ids)
    rows = zip(ids.ravel().tolist(), points.reshape(-1, 3), pixels.reshape(-1, 2), strict=True)
    return {number: (point.astype(np.float64), pixel.astype(np.float64)) for number, point, pixel in rows}


def _detector(settings: BoardSettings) -> tuple[Any, Any]:
    """Returns OpenCV's detector and its board; raises InputError for values that are not possible."""
    marker = settings.marker_m if settings.marker_m is not None else 0.75 * settings.square_m
    across, down = settings.squares
    if not (across >= 3 and down >= 3 and 0.0 < marker < settings.square_m):
        raise InputError(
            f"a board needs 3 x 3 squares or more and markers smaller than these, got {across} x {down}, squares of "
            f"{1e3 * settings.square_m:g} mm, markers of {1e3 * marker:g} mm"
        )
    code = getattr(cv2.aruco, settings.dictionary, None)
    if not (settings.dictionary.startswith("DICT_") and isinstance(code, int)):
        known = ", ".join(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))[:6])
        raise InputError(f"dictionary {settings.dictionary}: OpenCV does not know it; it has {known} and others")
    dictionary = cv2.aruco.getPredefinedDictionary(code)
    needed, there = across * down // 2, len(dictionary.bytesList)
    if needed > there:
        raise InputError(f"a board of {across} x {down} squares has {needed} markers, {settings.dictionary} {there}")
    board = cv2.aruco.CharucoBoard((across, down), settings.square_m, marker, dictionary)
    return cv2.aruco.CharucoDetector(board), board


def _plain_scale(flat: FloatArray, pixels: FloatArray) -> tuple[float, float, float, float]:
    """Fits a similarity (turn, scale, shift) from a plane to the image, with points as complex numbers.

    Args:
        flat: (n, 2) points of the plane in m.
        pixels: (n, 2) their pixels.

    Returns:
        The scale in m/px, the largest residual in px, the noise in px, and the relative range of the local scales,
        which come from a polynomial of the third degree.
    """
    middle, size = flat.mean(axis=0), float(np.ptp(flat, axis=0).max())
    plane = (flat - middle) @ np.array([1.0, 1.0j])
    image = (pixels - pixels.mean(axis=0)) @ np.array([1.0, 1.0j])
    # a board that is viewed from above is mirrored in pixels, whose v points down
    factors = [
        (complex(np.vdot(each, image)) / float(np.vdot(each, each).real), each) for each in (plane, plane.conj())
    ]
    factor, matched = factors[0] if abs(factors[0][0]) > abs(factors[1][0]) else factors[1]
    residual = np.abs(image - factor * matched)
    # polynomial from the plane to the image; the root of its Jacobian's determinant is the local scale in px/m
    x, y = ((flat - middle) / size).T
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    columns = np.stack([x**i * y**j for i, j in powers], axis=1)
    if len(flat) < 2 * len(powers):
        return 1.0 / float(abs(factor)), float(residual.max()), float(np.sqrt(np.mean(residual**2))), math.nan
    coefficients = np.linalg.lstsq(columns, pixels, rcond=None)[0]
    polynomial_residual = pixels - columns @ coefficients
    noise = float(np.sqrt(np.sum(polynomial_residual**2) / max(2 * len(flat) - 2 * len(powers), 1)))
    dx = np.stack([i * x ** max(i - 1, 0) * y**j for i, j in powers], axis=1) @ coefficients / size
    dy = np.stack([j * x**i * y ** max(j - 1, 0) for i, j in powers], axis=1) @ coefficients / size
    local_scale = np.sqrt(np.abs(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]))
    low, high = np.percentile(local_scale, [2.0, 98.0])
    return 1.0 / float(abs(factor)), float(residual.max()), noise, float((high - low) / np.median(local_scale))


def _lens_px(matrix: Any, distortion: FloatArray, size: tuple[int, int]) -> float:
    """Returns the largest displacement in px by the lens in an image of ``size`` (width, height)."""
    width, height = size
    u, v = np.meshgrid(np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 13))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    straight = cv2.undistortPoints(pixels[:, None], matrix, distortion, P=matrix).reshape(-1, 2)
    return float(np.linalg.norm(straight - pixels, axis=1).max())


def scale_from_ruler(ends_px: tuple[float, float, float, float], length_mm: float) -> Quantity:
    """Returns the scale from two image points and their distance.

    Args:
        ends_px: the points u0, v0, u1, v1.
        length_mm: their distance.

    Raises:
        InputError: the points are too near to each other, or the distance is not positive.

    >>> round(scale_from_ruler((100, 200, 500, 200), 80.0).value, 7)
    0.0002
    """
    distance_px = math.hypot(ends_px[2] - ends_px[0], ends_px[3] - ends_px[1])
    if not (distance_px > 10.0 * CLICK_STD_PX and length_mm > 0.0 and math.isfinite(distance_px * length_mm)):
        raise InputError(
            f"ruler: the distance of the points is {distance_px:.3g} px and {length_mm:g} mm; mark them farther apart"
        )
    scale = 1e-3 * length_mm / distance_px
    std = scale * math.sqrt(2.0) * CLICK_STD_PX / distance_px
    doubt = "" if std < 5e-3 * scale else f"the distance of the points is only {distance_px:.0f} px"
    return Quantity("scale, by the ruler", scale, std, "m/px", 1, written=True, doubt=doubt)


def scale_from_shaft(path: Path, view: str, info: SessionInfo) -> Quantity:
    """Returns the scale of a view from the stated diameter of the shaft and the detected one, for want of a better one.

    Args:
        path: a recording.
        view: the view.
        info: session metadata, with ``catheter.diameter_m``.

    Raises:
        FileFormatError: the recording cannot be read.
        InputError: no diameter is stated, or the catheter is detected in fewer than `MIN_DIAMETERS` images.
    """
    diameter = info.catheter.diameter_m
    if diameter is None:
        raise InputError(
            f"{path}: catheter.diameter_m is not stated, and the scale is to come from it; state it in bench.toml, in "
            "metres"
        )
    with RecordingReader(path) as reader:
        images = spread_images(reader, view)
    # a stated size would draw the detected diameter to it
    scale_free = replace(info.view(view), metres_per_px=None, metres_per_px_uncertainty=None)
    sizeless_info = replace(info, catheter=Catheter(), views={**info.views, view: scale_free})
    detector = SessionDetector(VisionSettings(view=view), sizeless_info, images)
    widths = np.array([detector.detect(image).diameter_px for image in images])
    widths = widths[np.isfinite(widths)]
    if len(widths) < MIN_DIAMETERS:
        raise InputError(
            f"{path}: the diameter of the catheter is detected in {len(widths)} of {len(images)} images of the view "
            f"{view}, {MIN_DIAMETERS} are needed; see `tipforce inspect`, or mark two points with --ruler"
        )
    scale = diameter / float(np.median(widths))
    scatter = 1.4826 * float(np.median(np.abs(widths - np.median(widths)))) / float(np.median(widths))
    # the error that all images share, and the scatter of the median (1.4826 makes a median deviation a standard one)
    shared_share = XRAY_SHAFT_STD_SHARE if info.view(view).modality == "xray" else CAMERA_SHAFT_STD_SHARE
    std = scale * math.hypot(shared_share, scatter / math.sqrt(len(widths)))
    return Quantity(
        f"scale of {view}, by the shaft", scale, std, "m/px", len(widths), f"views.{view}.metres_per_px",
        before=info.view(view).metres_per_px, written=True,
    )  # fmt: skip


def scale_from_diameter(sessions: Sequence[CalibrationSession]) -> Quantity | None:
    """Returns the scale from the shaft's stated diameter and its detected one; None if no diameter is stated.

    It is not accurate, because blur and shadow move the flanks. It shows a wrong unit or camera, and is never written.
    """
    diameter = sessions[0].info.catheter.diameter_m
    widths = np.concatenate([each.diameter_px for each in sessions])
    widths = widths[np.isfinite(widths)]
    if diameter is None or not len(widths):
        return None
    scale, stated_scale = diameter / float(np.median(widths)), sessions[0].scale_m_per_px
    std = scale * DIAMETER_STD_SHARE
    doubt = "a check only: blur and shadow move the shaft's flanks"
    if abs(scale - stated_scale) > 3.0 * std:
        doubt = (
            f"it differs by {scale / stated_scale - 1.0:+.0%} from the stated scale: check metres_per_px and diameter_m"
        )
    return Quantity("scale, by the shaft", scale, std, "m/px", len(widths), before=stated_scale, doubt=doubt)
