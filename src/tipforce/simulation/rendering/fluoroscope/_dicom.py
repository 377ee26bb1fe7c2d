"""A run of X-ray images as a DICOM XA file (X-Ray Angiographic Image Storage, PS3.3 A.14)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...._system.extras import import_extra
from ....errors import InputError
from ._scene import XrayScene

RESEARCH_NOTE = "Research use only. Simulated image of no patient, made by tipforce."

Images = Sequence[npt.NDArray[np.uint8]] | Sequence[npt.NDArray[np.uint16]]


def write_dicom(
    path: str | Path, frames: Images, stamps_ns: Sequence[int], scene: XrayScene, *, view: int = 0, bits: int = 8
) -> None:
    """Writes images of one view with their stamps as one multi-frame file, lossless and not compressed.

    Geometry is the calibration as stated, never the truth. Times are the stamps: ContentTime is their zero, FrameDelay
    and FrameTimeVector count from there, so planes of one run stay on one clock with any dropped frames. Planes
    of one scene share study, series and frame of reference. The same arguments give the same bytes.

    Args:
        path: path of the file.
        frames: n images (h, w) of one `XrayRenderer`.
        stamps_ns: (n,) stamps in ns, rising.
        scene: the scene of the images.
        view: number of the view.
        bits: bits of a grey level: 8 for uint8 images, 9 to 16 for uint16 images.

    Raises:
        InputError: the images differ in shape or type, or the stamps do not rise.
        MissingExtraError: pydicom is not installed.
    """
    pydicom = import_extra("pydicom", "dicom")
    kind = np.uint8 if bits == 8 else np.uint16
    shapes = {(frame.shape, frame.dtype) for frame in frames}
    if len(shapes) != 1 or len(next(iter(shapes))[0]) != 2 or next(iter(shapes))[1] != kind:
        raise InputError(f"{path}: expected frames of one shape (h, w) and type {np.dtype(kind).name}, got {shapes}")
    stamps = np.asarray(stamps_ns, np.int64)
    if stamps.shape != (len(frames),) or (np.diff(stamps) <= 0).any():
        raise InputError(f"{path}: expected {len(frames)} rising stamps, one a frame, got {len(stamps)}")
    data = _identity(pydicom, scene, view, stamps)
    _add_geometry(data, scene, view, frames[0].shape[1])
    _add_acquisition(data, scene, view)
    burned_in = scene.variety is not None and any(scene.variety.processing.text)
    _add_pixels(pydicom, data, frames, stamps, (scene.views[view].detector.curve, burned_in), bits)
    data.save_as(str(path), enforce_file_format=True)


def _identity(pydicom: Any, scene: XrayScene, view: int, stamps: npt.NDArray[np.int64]) -> Any:
    """Makes a dataset with the modules of patient, study, series, equipment and image of ``view``.

    The unique identifiers (UIDs) are hashes of the scene, the view and the ``stamps`` (n,): the same images get the
    same ones again.
    """

    def uid(*parts: object) -> Any:
        return pydicom.uid.generate_uid(entropy_srcs=["tipforce", repr(scene), *map(str, parts)])

    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = pydicom.uid.XRayAngiographicImageStorage
    meta.MediaStorageSOPInstanceUID = uid("image", view, stamps.tolist())
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    meta.ImplementationClassUID = pydicom.uid.generate_uid(entropy_srcs=["tipforce", "implementation"])
    meta.ImplementationVersionName = "TIPFORCE"
    data = pydicom.dataset.Dataset()
    data.file_meta = meta
    data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    data.SpecificCharacterSet = "ISO_IR 192"
    data.PatientName, data.PatientID = "Simulated^Tipforce", "SIMULATED"
    data.PatientBirthDate, data.PatientSex = "", "O"
    data.StudyInstanceUID, data.SeriesInstanceUID = uid("study"), uid("series")
    # One frame of reference: the angles and distances of both planes are about the same isocentre.
    data.FrameOfReferenceUID, data.PositionReferenceIndicator = uid("frame of reference"), ""
    data.StudyDate, data.StudyTime, data.ReferringPhysicianName = "", "", ""
    data.StudyID, data.AccessionNumber, data.SeriesNumber, data.InstanceNumber = "1", "", 1, view + 1
    data.Modality, data.Manufacturer, data.ManufacturerModelName = "XA", "tipforce", "simulation"
    data.DeviceSerialNumber, data.SoftwareVersions = "0", "tipforce"
    # A simulated patient has no date; the time is the zero of the stamps of all planes.
    data.ContentDate, data.ContentTime, data.PatientOrientation = "", "000000.000000", ""
    planes = "SINGLE PLANE" if len(scene.views) == 1 else ("BIPLANE A", "BIPLANE B")[view]
    data.ImageType = ["ORIGINAL", "PRIMARY", planes]
    data.SeriesDescription = "Simulated cardiac fluoroscopy"
    data.ImageComments, data.PatientComments = RESEARCH_NOTE, RESEARCH_NOTE
    return data


def _add_geometry(data: Any, scene: XrayScene, view: int, width: int) -> None:
    """Adds the XA positioner module (stated angles in degrees, distances in mm) and the detector's pitch in mm."""
    arm = scene.views[view].stated
    data.PositionerMotion = "STATIC"
    data.PositionerPrimaryAngle = f"{arm.primary_deg:.2f}"
    data.PositionerSecondaryAngle = f"{arm.secondary_deg:.2f}"
    data.DistanceSourceToDetector = f"{1e3 * arm.source_detector_m:.3f}"
    data.DistanceSourceToPatient = f"{1e3 * arm.source_object_m:.3f}"
    data.EstimatedRadiographicMagnificationFactor = f"{arm.magnification:.6f}"
    pitch = f"{1e3 * arm.imager_spacing_m(width):.6f}"
    data.ImagerPixelSpacing = [pitch, pitch]


def _add_acquisition(data: Any, scene: XrayScene, view: int) -> None:
    """Adds the X-ray acquisition module: the known values of the beam, times in ms."""
    beam = scene.views[view].beam
    data.KVP = f"{beam.kvp:g}"
    data.RadiationSetting, data.RadiationMode = "SC", "PULSED"
    data.ExposureTime = round(1e3 * beam.pulse_s)
    data.AveragePulseWidth = f"{1e3 * beam.pulse_s:.3f}"
    data.FocalSpots = [f"{1e3 * 3 * beam.focal_spot_m:.2f}"]  # the nominal size in mm is three standard deviations
    data.CineRate = round(beam.rate_hz)
    data.RecommendedDisplayFrameRate = round(beam.rate_hz)


def _add_pixels(
    pydicom: Any, data: Any, frames: Images, stamps: npt.NDArray[np.int64], shown: tuple[str, bool], bits: int
) -> None:
    """Adds the multi-frame, cine and image pixel modules for n ``frames`` (h, w) with ``stamps`` (n,) in ns.

    ``shown``: curve of the display ("log" or "linear"), and whether the display adds text to the images.
    """
    curve, burned_in = shown
    data.NumberOfFrames = len(frames)
    data.FrameIncrementPointer = pydicom.tag.Tag("FrameTimeVector")
    # The first increment is 0 by definition, and the time before the first frame is the delay; all in milliseconds.
    data.FrameDelay = f"{int(stamps[0]) / 1e6:.6f}"
    data.FrameTimeVector = [f"{step:.6f}" for step in np.diff(stamps, prepend=stamps[:1]) / 1e6]
    data.Rows, data.Columns = frames[0].shape
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated = 8 if bits == 8 else 16
    data.BitsStored, data.HighBit, data.PixelRepresentation = bits, bits - 1, 0
    data.PixelIntensityRelationship = "LOG" if curve == "log" else "LIN"
    data.PixelIntensityRelationshipSign = 1
    data.WindowCenter, data.WindowWidth = str(1 << (bits - 1)), str(1 << bits)
    data.BurnedInAnnotation, data.LossyImageCompression = "YES" if burned_in else "NO", "00"
    pixels = np.stack(list(frames)).tobytes()
    data.add_new("PixelData", "OB" if bits == 8 else "OW", pixels + b"\0" * (len(pixels) % 2))
