"""A C-arm as a pinhole camera: focal spot, detector, and their positions around the patient."""

import math
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray
from ._camera import CameraModel
from ._pose import Pose


@dataclass(frozen=True, slots=True)
class CArm:
    """Positions of the focal spot and the detector of one plane, in DICOM's words.

    The patient's frame is DICOM's: origin at the isocentre, x to the patient's left, y to the back, z to the head.
    Images are shown as usual: the viewer looks from the detector to the tube, so that from the front the patient's
    left is at the image's right.

    Attributes:
        primary_deg: positioner primary angle, positive toward LAO (the patient's left), 0: from back to front (AP).
        secondary_deg: positioner secondary angle, positive toward cranial.
        source_detector_m: distance from focal spot to detector.
        source_object_m: distance from focal spot to isocentre.
        scale_m_per_px: scale at the isocentre, for 512 columns.
        roll_deg: turn of the detector in its own plane.
        centre_px: (2,) point of the central ray on the detector, from the image's middle, for 512 columns.
    """

    primary_deg: float
    secondary_deg: float
    source_detector_m: float
    source_object_m: float
    scale_m_per_px: float
    roll_deg: float = 0.0
    centre_px: tuple[float, float] = (0.0, 0.0)

    @property
    def magnification(self) -> float:
        """Magnification of an object at the isocentre, on the detector."""
        return self.source_detector_m / self.source_object_m

    def imager_spacing_m(self, width: int = 512) -> float:
        """Returns the pitch of the detector's pixels in an image of ``width`` columns."""
        return self.scale_m_per_px * 512.0 / width * self.magnification

    def display_axes(self) -> FloatArray:
        """Returns rows (3, 3), patient's frame: the image's right, its up, and from tube to detector (to the viewer).

        >>> CArm(0.0, 0.0, 1.1, 0.75, 0.25e-3).display_axes() + 0.0
        array([[ 1.,  0.,  0.],
               [ 0.,  0.,  1.],
               [ 0., -1.,  0.]])
        """
        p, s, r = (math.radians(a) for a in (self.primary_deg, self.secondary_deg, self.roll_deg))
        right = np.array([math.cos(p), math.sin(p), 0.0])
        toward = np.array([math.sin(p) * math.cos(s), -math.cos(p) * math.cos(s), math.sin(s)])
        up = np.cross(toward, right)
        return np.array([math.cos(r) * right + math.sin(r) * up, math.cos(r) * up - math.sin(r) * right, toward])

    def camera(self, width: int = 512, height: int = 512) -> CameraModel:
        """Returns the pinhole camera at the focal spot; fx is negative (see `CameraModel`).

        Args:
            width: width of the image in px.
            height: height of the image in px.

        Returns:
            The camera model; its world is the patient's frame.
        """
        axes = self.display_axes()
        finer = width / 512.0
        focal = self.source_object_m / self.scale_m_per_px * finer
        centre = 0.5 * np.array([width - 1.0, height - 1.0]) + finer * np.array(self.centre_px)
        rotation = np.array([-axes[0], -axes[1], axes[2]])
        return CameraModel(
            np.array([-focal, focal]),
            centre,
            camera_from_world=Pose(rotation, np.array([0.0, 0.0, self.source_object_m])),
        )
