"""The camera: its scale in the plane in which the catheter bends, and how far lens and tilt bend that plane.

Three ways, from the best to the poorest: a ChArUco board that lies in the plane of bending; two image points whose
distance is known; the shaft, whose diameter is stated. The detection works on the image as it is, with one scale for
all of it: `BoardResult` says how far from that lens and tilt are.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..errors import InputError
from ..types import FloatArray, Image
from ._quantity import Quantity
from ._session import CalibrationSession

_LEAST_CORNERS, _LEAST_LENS_IMAGES = 8, 6
"""Corners of one image; images from which the lens is found too."""
_CLICK_PX = 1.0
"""Standard deviation of a point that a person marks."""
_FLANKS_SHARE = 0.03
"""Of the shaft's detected diameter: blur, shadow and light move both flanks."""
_PRINT_SHARE = 2e-3
"""Of a printed board's squares."""
_LARGE_SHARE, _LARGE_TILT_DEG = 0.01, 5.0
FORCE_PER_SCALE = 2.0
"""A relative error of the scale is so much of the force at most: by the rod's law EI / length^2."""


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """A ChArUco board: ``squares`` (across, down), length of a square and of a marker, and the markers' dictionary."""

    squares: tuple[int, int] = (7, 5)
    square_m: float = 5e-3
    marker_m: float | None = None
    """None: three quarters of a square."""
    dictionary: str = "DICT_4X4_50"


@dataclass(frozen=True, slots=True, eq=False)
class BoardResult:
    """What a board shows.

    ``metres_per_px``, ``scale_std``: in its plane in the first image, at its middle. ``tilt_deg``: of that plane to
    the image's, NaN where the lens is not known. ``worst_px``: how far the image of that plane lies off a plain scale
    at most, within the board's outline; ``scale_range``: relative, between its parts. ``distortion`` (5,): k1, k2, p1,
    p2, k3, and ``focal_px``, where several images showed the board from several sides, else None and NaN; ``lens_px``:
    the most that the lens alone moves a pixel of the image. ``corners``, ``images``: so many were found.
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
        """The scale; the caller knows of which view."""
        doubts: list[str] = []
        if self.scale_range > _LARGE_SHARE:
            doubts.append(
                f"it differs by {self.scale_range:.1%} over the board ({self.worst_px:.1f} px off a plain scale), "
                f"which is up to {FORCE_PER_SCALE * self.scale_range:.1%} of the force; detection does not undistort"
            )
        if self.tilt_deg > _LARGE_TILT_DEG:
            doubts.append(f"the board is tilted by {self.tilt_deg:.0f} deg: look straight down on the plane of bending")
        return Quantity(
            "scale, by the board", self.metres_per_px, self.scale_std, "m/px", self.images, written=True,
            doubt="; ".join(doubts),
        )  # fmt: skip

    def figures(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "metres_per_px": self.metres_per_px, "scale_std": self.scale_std, "tilt_deg": self.tilt_deg,
            "worst_px": self.worst_px, "scale_range": self.scale_range, "focal_px": self.focal_px,
            "distortion": None if self.distortion is None else self.distortion.tolist(), "lens_px": self.lens_px,
            "residual_px": self.residual_px, "corners": self.corners, "images": self.images,
        }  # fmt: skip


def calibrate_board(images: Sequence[Image], settings: BoardSettings) -> BoardResult:
    """Scale, tilt and lens from images of a ChArUco board.

    Args:
        images: the first shows the board lying in the plane in which the catheter bends; five and more others, with the
            board tilted this way and that, tell the lens.
        settings: of the board.

    Raises:
        InputError: the board's values are none, its dictionary is unknown, or no board is found in the first image.
    """
    detector, board = _detector(settings)
    found: list[tuple[FloatArray, FloatArray]] = []
    for k, image in enumerate(images):
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        corners, ids, _, markers = detector.detectBoard(grey)
        count = 0 if ids is None else len(ids)
        if count < _LEAST_CORNERS:
            if k == 0:
                seen = 0 if markers is None else len(markers)
                raise InputError(
                    f"the board shows {count} corners and {seen} markers in the first image, {_LEAST_CORNERS} corners "
                    "are needed: check squares and dictionary of the board"
                )
            continue
        object_points, image_points = board.matchImagePoints(corners, ids)
        found.append((object_points.reshape(-1, 3), image_points.reshape(-1, 2)))
    height, width = images[0].shape[:2]
    flat, seen = found[0][0][:, :2].astype(np.float64), found[0][1].astype(np.float64)
    scale, worst, residual, spread = _plain_scale(flat, seen)
    tilt, focal, lens_px, distortion = math.nan, math.nan, math.nan, None
    if len(found) >= _LEAST_LENS_IMAGES:
        # k2 and k3 need boards that fill every corner of the image; k1, p1 and p2 are what a bench's lens has
        rms, matrix, coefficients, turns, _, _, _, _ = cv2.calibrateCameraExtended(
            [points.astype(np.float32) for points, _ in found], [pixels.astype(np.float32) for _, pixels in found],
            (width, height), np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3,
        )  # fmt: skip
        normal = cv2.Rodrigues(turns[0])[0][:, 2]
        tilt = math.degrees(math.acos(min(1.0, abs(float(normal[2])))))
        focal, residual = float(matrix[0, 0]), float(rms)
        distortion = np.asarray(coefficients, np.float64).ravel()[:5]
        lens_px = _lens_px(matrix, distortion, (width, height))
    std = scale * math.hypot(_PRINT_SHARE, residual / max(float(np.ptp(seen, axis=0).max()), 1.0))
    return BoardResult(
        scale, std, tilt, worst, spread, focal, distortion, lens_px, residual, len(seen), len(found)
    )  # fmt: skip


def _detector(settings: BoardSettings) -> tuple[Any, Any]:
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


def _plain_scale(flat: FloatArray, seen: FloatArray) -> tuple[float, float, float, float]:
    """Scale of the best similarity, m/px; how far it misses at most, px; noise, px; relative range of local scales.

    Points of a plane (n, 2) in m and their pixels (n, 2). Local scales by a polynomial of the third degree.
    """
    middle, size = flat.mean(axis=0), float(np.ptp(flat, axis=0).max())
    a = (flat - middle) @ np.array([1.0, 1.0j])
    b = (seen - seen.mean(axis=0)) @ np.array([1.0, 1.0j])
    # a board that is seen from above is mirrored in pixels, whose v points down
    ways = [(complex(np.vdot(each, b)) / float(np.vdot(each, each).real), each) for each in (a, a.conj())]
    way, turned = ways[0] if abs(ways[0][0]) > abs(ways[1][0]) else ways[1]
    miss = np.abs(b - way * turned)
    x, y = ((flat - middle) / size).T
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    columns = np.stack([x**i * y**j for i, j in powers], axis=1)
    if len(flat) < 2 * len(powers):
        return 1.0 / float(abs(way)), float(miss.max()), float(np.sqrt(np.mean(miss**2))), math.nan
    solved = np.linalg.lstsq(columns, seen, rcond=None)[0]
    left = seen - columns @ solved
    noise = float(np.sqrt(np.sum(left**2) / max(2 * len(flat) - 2 * len(powers), 1)))
    dx = np.stack([i * x ** max(i - 1, 0) * y**j for i, j in powers], axis=1) @ solved / size
    dy = np.stack([j * x**i * y ** max(j - 1, 0) for i, j in powers], axis=1) @ solved / size
    local = np.sqrt(np.abs(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]))
    low, high = np.percentile(local, [2.0, 98.0])
    return 1.0 / float(abs(way)), float(miss.max()), noise, float((high - low) / np.median(local))


def _lens_px(matrix: Any, distortion: FloatArray, size: tuple[int, int]) -> float:
    """The most that the lens moves a pixel of an image of ``size`` (width, height)."""
    width, height = size
    u, v = np.meshgrid(np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 13))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    straight = cv2.undistortPoints(pixels[:, None], matrix, distortion, P=matrix).reshape(-1, 2)
    return float(np.linalg.norm(straight - pixels, axis=1).max())


def scale_from_ruler(ends_px: tuple[float, float, float, float], length_mm: float) -> Quantity:
    """The scale from two image points u0, v0, u1, v1 and their distance in mm.

    Raises InputError where the points are one, or the distance is none.

    >>> round(scale_from_ruler((100, 200, 500, 200), 80.0).value, 7)
    0.0002
    """
    apart = math.hypot(ends_px[2] - ends_px[0], ends_px[3] - ends_px[1])
    if not (apart > 10.0 * _CLICK_PX and length_mm > 0.0 and math.isfinite(apart * length_mm)):
        raise InputError(
            f"ruler: the points lie {apart:.3g} px apart and stand for {length_mm:g} mm; mark them farther"
        )
    scale = 1e-3 * length_mm / apart
    std = scale * math.sqrt(2.0) * _CLICK_PX / apart
    doubt = "" if std < 5e-3 * scale else f"the points lie only {apart:.0f} px apart"
    return Quantity("scale, by the ruler", scale, std, "m/px", 1, written=True, doubt=doubt)


def scale_from_diameter(sessions: Sequence[CalibrationSession]) -> Quantity | None:
    """The scale from the shaft's stated diameter and its detected one; None where none is stated.

    Poor: blur and shadow move the flanks. It finds a wrong unit or a wrong camera, and is never written.
    """
    diameter = sessions[0].info.catheter.diameter_m
    widths = np.concatenate([each.diameter_px for each in sessions])
    widths = widths[np.isfinite(widths)]
    if diameter is None or not len(widths):
        return None
    scale, before = diameter / float(np.median(widths)), sessions[0].scale_m_per_px
    std = scale * _FLANKS_SHARE
    doubt = "a check only: blur and shadow move the shaft's flanks"
    if abs(scale - before) > 3.0 * std:
        doubt = f"it is {scale / before - 1.0:+.0%} off the stated scale: check metres_per_px and diameter_m"
    return Quantity("scale, by the shaft", scale, std, "m/px", len(widths), before=before, doubt=doubt)
