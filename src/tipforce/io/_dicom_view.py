"""The geometry of a view in the header of a DICOM file: C-arm angles, distances, pixels of the detector."""

import math
from dataclasses import dataclass
from typing import Any

from ..geometry import CArm
from ..types import ViewInfo

XRAY_MODALITIES = ("XA", "RF", "DX", "CR")
ASSUMED_TURN_DEG = (1.0, 1.0, 0.5)
"""Assumed standard uncertainties of a C-arm's angles, and of the turn of the detector in its own plane."""
ASSUMED_SHIFT_M = (2e-3, 2e-3, 5e-3)
"""The same of the isocentre: from the middle of the image, right and down, and of its distance from the focal spot."""
DEPTH_STD_M = 30e-3
"""Assumed distance between catheter and isocentre along the ray, which no tag states."""
SOURCE_ISOCENTRE_M, SOURCE_ISOCENTRE_STD_M = 0.75, 0.04
"""Where it is not stated: C-arms have 0.70 to 0.81 m from focal spot to isocentre."""
MAGNIFICATION, MAGNIFICATION_STD = 1.4, 0.12
"""Where no distance is stated: 1.0 to 1.2 m from focal spot to detector, over 0.75 m."""
SPACING_STD_SHARE = 0.02
"""Assumed relative standard uncertainty of a PixelSpacing that was calibrated with an object of known size."""


@dataclass(frozen=True, slots=True)
class DicomView:
    """Geometry that the header states.

    Attributes:
        info: scale and projection with standard uncertainties, as far as the header states them.
        plane: "a" or "b" for a plane of a biplane system, else "".
        found: a sentence on the geometry that was found; "" where nothing was.
        missing: sentences on tags that are missing, each with a remedy; ``{view}`` is in place of the view's name.
    """

    info: ViewInfo
    plane: str = ""
    found: str = ""
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Scale:
    """Scale of an X-ray image at the isocentre.

    Attributes:
        metres_per_px: width of a pixel, projected to the isocentre.
        share_std: relative standard uncertainty of it.
        source_object_m: distance from focal spot to isocentre.
        source_object_std_m: standard uncertainty of this distance.
        from_text: source of the scale, for messages.
    """

    metres_per_px: float
    share_std: float
    source_object_m: float
    source_object_std_m: float
    from_text: str


def view_from_header(data: Any, width: int, height: int) -> DicomView:
    """Reads the geometry of a view.

    Args:
        data: the pydicom dataset.
        width: width of the image with square pixels.
        height: height of the image with square pixels.

    Returns:
        The geometry; empty for a file that is no X-ray image.
    """
    kinds = [str(each).upper() for each in data.get("ImageType") or ()]
    plane = next((letter for letter in "ab" if f"BIPLANE {letter.upper()}" in kinds), "")
    if str(data.get("Modality", "")).upper() not in XRAY_MODALITIES:
        return DicomView(ViewInfo(), plane)
    try:
        return _xray_view(data, width, height, plane)
    except (TypeError, ValueError) as error:
        text = (
            f"its header is not used for the geometry: {error}; state views.{{view}}.metres_per_px, and for two views "
            "views.{view}.projection, in bench.toml"
        )
        return DicomView(ViewInfo(modality="xray"), plane, missing=(text,))


def _xray_view(data: Any, width: int, height: int, plane: str) -> DicomView:
    """Returns the geometry of an X-ray image; see `view_from_header`."""
    missing: list[str] = []
    scale = _scale(data, missing)
    if scale is None:
        return DicomView(ViewInfo(modality="xray"), plane, missing=tuple(missing))
    share = math.hypot(scale.share_std, _table_shift_m(data, missing) / scale.source_object_m)
    description = (
        f"{1e3 * scale.metres_per_px:.4g} mm a pixel at the isocentre, from {scale.from_text}, +- {share:.1%} because "
        f"the catheter's distance from the isocentre is not stated ({1e3 * DEPTH_STD_M:.0f} mm are assumed)"
    )
    info = ViewInfo(
        float(f"{scale.metres_per_px:.6g}"), modality="xray", metres_per_px_uncertainty=float(f"{share:.2g}")
    )
    angles = _angles(data, missing)
    if angles is None:
        return DicomView(info, plane, description, tuple(missing))
    primary, secondary = angles  # degrees
    arm = CArm(
        primary,
        secondary,
        MAGNIFICATION * scale.source_object_m,  # without effect on the projection, which the scale determines
        scale.source_object_m,
        scale.metres_per_px * width / 512.0,  # `CArm` takes the scale of an image with 512 columns
    )
    info = ViewInfo(
        info.metres_per_px,
        modality="xray",
        metres_per_px_uncertainty=info.metres_per_px_uncertainty,
        projection=arm.camera(width, height).projection,
        projection_frame="isocentre",
        pose_uncertainty_deg=ASSUMED_TURN_DEG,
        pose_uncertainty_m=(*ASSUMED_SHIFT_M[:2], scale.source_object_std_m),
    )
    first = f"{'LAO' if primary >= 0 else 'RAO'} {abs(primary):g}"
    second = f"{'cranial' if secondary >= 0 else 'caudal'} {abs(secondary):g}"
    description = f"C-arm at {first}, {second} degrees, +- {ASSUMED_TURN_DEG[0]:g} assumed; {description}"
    return DicomView(info, plane, description, tuple(missing))


def _positive(data: Any, name: str) -> float | None:
    """Returns the value of a tag; None where it is missing, empty or 0, as some devices write it."""
    stated = data.get(name)
    if stated is None or stated == "":
        return None
    value = float(stated)
    if value < 0 or not math.isfinite(value):
        raise ValueError(f"{name} is {value:g}")
    return value or None


def _spacing_m(data: Any, name: str) -> float | None:
    """Returns the distance of pixels in m, after they were made square; None where it is missing."""
    stated = data.get(name)
    if stated is None or stated == "":
        return None
    values = [float(each) for each in stated]
    if len(values) != 2 or not all(0 < value < math.inf for value in values):
        raise ValueError(f"{name} is {values}")
    return 1e-3 * min(values)


def _scale(data: Any, missing: list[str]) -> _Scale | None:
    """Returns the scale at the isocentre; None where no tag states the distance of pixels.

    It is the pitch of the detector's pixels over the magnification: distance from focal spot to detector over that to
    the isocentre. Sentences on assumed values are added to ``missing``.

    Raises:
        ValueError: a tag is impossible.
    """
    detector = _positive(data, "DistanceSourceToDetector")
    isocentre = _positive(data, "DistanceSourceToPatient")
    stated_magnification = _positive(data, "EstimatedRadiographicMagnificationFactor")
    if detector and isocentre and isocentre >= detector:
        raise ValueError(
            f"DistanceSourceToPatient is {isocentre:g} mm, behind the detector at DistanceSourceToDetector "
            f"{detector:g} mm"
        )
    if stated_magnification is not None and stated_magnification < 1.0:
        raise ValueError(f"EstimatedRadiographicMagnificationFactor is {stated_magnification:g}, less than 1")
    if isocentre:
        object_m, object_std = 1e-3 * isocentre, ASSUMED_SHIFT_M[2]
    elif detector and stated_magnification:
        object_m, object_std = 1e-3 * detector / stated_magnification, ASSUMED_SHIFT_M[2]
    else:
        object_m, object_std = SOURCE_ISOCENTRE_M, SOURCE_ISOCENTRE_STD_M
    depth_share = math.hypot(object_std, DEPTH_STD_M) / object_m
    spacing, pitch = _spacing_m(data, "PixelSpacing"), _spacing_m(data, "ImagerPixelSpacing")
    calibrated = str(data.get("PixelSpacingCalibrationType", "")).upper()
    if spacing and calibrated == "FIDUCIAL":
        share = math.hypot(SPACING_STD_SHARE, DEPTH_STD_M / object_m)
        return _Scale(spacing, share, object_m, object_std, "PixelSpacing, calibrated with an object")
    if pitch is None and spacing and calibrated == "GEOMETRY":
        return _Scale(spacing, depth_share, object_m, object_std, "PixelSpacing, corrected by the system's geometry")
    if pitch is None:
        missing.append(
            "ImagerPixelSpacing is missing, so neither scale nor pose is known; state views.{view}.metres_per_px in "
            "bench.toml, or find it with `tipforce calibrate --ruler`"
        )
        return None
    if detector:
        magnification, share = 1e-3 * detector / object_m, depth_share
        text = "ImagerPixelSpacing over the distances of the focal spot"
        if not (isocentre or stated_magnification):
            missing.append(
                f"DistanceSourceToPatient is missing: {1e3 * object_m:.0f} +- {1e3 * object_std:.0f} mm are assumed"
            )
    elif stated_magnification:
        magnification, share = stated_magnification, depth_share
        text = "ImagerPixelSpacing over EstimatedRadiographicMagnificationFactor"
    else:
        magnification, share = MAGNIFICATION, math.hypot(MAGNIFICATION_STD / MAGNIFICATION, DEPTH_STD_M / object_m)
        text = "ImagerPixelSpacing over an assumed magnification"
        missing.append(
            "DistanceSourceToDetector is missing: a magnification of "
            f"{MAGNIFICATION:g} +- {MAGNIFICATION_STD:g} is assumed; better, state views.{{view}}.metres_per_px"
        )
    return _Scale(pitch / magnification, share, object_m, object_std, text)


def _angles(data: Any, missing: list[str]) -> tuple[float, float] | None:
    """Returns primary and secondary angle in degrees; None where the pose of the view does not follow from them."""
    remedy = "; two views need a pose: state views.{view}.projection in bench.toml"
    names = ("PositionerPrimaryAngle", "PositionerSecondaryAngle")
    values = [None if data.get(name) in (None, "") else float(data.get(name)) for name in names]
    primary, secondary = values
    if primary is None or secondary is None:
        gone = " and ".join(name for name, value in zip(names, values, strict=True) if value is None)
        missing.append(f"{gone} {'are' if ' and ' in gone else 'is'} missing, so the pose is not known" + remedy)
        return None
    if abs(primary) > 180.0 or abs(secondary) > 90.0:
        raise ValueError(f"the positioner's angles are {primary:g} and {secondary:g} degrees")
    turn_deg = max(_largest_abs(data, f"{name}Increment") for name in names)
    if turn_deg > ASSUMED_TURN_DEG[0]:
        missing.append(
            f"the C-arm turns by {turn_deg:.0f} degrees during the run, so no pose holds for all frames" + remedy
        )
        return None
    image_turn_deg = float(data.get("FieldOfViewRotation") or 0)
    if image_turn_deg or str(data.get("FieldOfViewHorizontalFlip", "NO")).upper() == "YES":
        missing.append(
            f"the image is shown turned by {image_turn_deg:g} degrees or mirrored (FieldOfViewRotation, "
            "FieldOfViewHorizontalFlip), so the pose is not known" + remedy
        )
        return None
    return primary, secondary


def _largest_abs(data: Any, name: str) -> float:
    """Returns the largest absolute value of a tag with one number or several; 0 where it is missing."""
    stated = data.get(name)
    if stated is None or stated == "":
        return 0.0
    values = [stated] if isinstance(stated, int | float | str) else list(stated)
    return max((abs(float(value)) for value in values), default=0.0)


def _table_shift_m(data: Any, missing: list[str]) -> float:
    """Returns the standard deviation of the table's shift along the vertical, which changes the magnification, m.

    A shift that is uniform over a range has a standard deviation of the range / sqrt(12). A remark on any movement is
    added to ``missing``.
    """
    names = ("Vertical", "Longitudinal", "Lateral")
    moved_mm = {name: _largest_abs(data, f"Table{name}Increment") for name in names}
    if max(moved_mm.values()) > 0:
        text = ", ".join(f"{name.lower()} {value:g} mm" for name, value in moved_mm.items() if value)
        missing.append(f"the table moves during the run ({text}): not only the tissue moves in the images")
    return 1e-3 * moved_mm["Vertical"] / math.sqrt(12.0)
