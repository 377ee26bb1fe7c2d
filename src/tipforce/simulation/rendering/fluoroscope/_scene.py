"""The scene and the device of one session's fluoroscope: drawn once, the same for every frame."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ....geometry import CameraModel, CArm, Pose
from ....types import FloatArray

if TYPE_CHECKING:
    from ._variety import XrayVariety

Point = tuple[float, float, float]
"""In the patient's frame (`CArm`), metres."""


@dataclass(frozen=True, slots=True)
class XrayBeam:
    """Spectrum and intensity of the beam, and its share that arrives."""

    photons: float
    """Detected photons a pixel at 512 columns, mean over the measuring field in the image's middle."""
    pulse_s: float
    rate_hz: float
    focal_spot_m: float
    """Sigma."""
    control_s: float
    """How late the exposure control follows the patient's breath; it holds ``photons``."""
    kvp: float = 80.0
    """Tube voltage. The table of attenuation belongs to 80."""


@dataclass(frozen=True, slots=True)
class Detector:
    """From photons to grey levels; pixels are those of 512 columns."""

    scatter: float
    """Scattered over direct photons."""
    scatter_m: float
    """Sigma of their spread, at the isocentre."""
    glare: float
    """Share of all light that is spread over the image."""
    glare_m: float
    blur_px: tuple[float, float]
    """Sigmas of two Gaussians."""
    blur_tail: float
    """Share of the second."""
    lag: tuple[tuple[float, float], ...]
    """Exponentials: share of the light, and its rest a frame later."""
    electronic: float
    """Noise of a pixel, sigma in photons."""
    line_noise: float
    """Noise of a row, sigma in photons."""
    curve: str
    """Curve of the display: log or linear."""
    contrast: float
    """Log: grey levels (of 256) for a factor e in the light; linear: grey level of ``photons``."""


@dataclass(frozen=True, slots=True)
class XrayView:
    """One plane.

    Attributes:
        true: true position of the C-arm.
        stated: its position as calibrated, the only one that a user gets.
        beam: the beam.
        detector: the detector.
    """

    true: CArm
    stated: CArm
    beam: XrayBeam
    detector: Detector


@dataclass(frozen=True, slots=True)
class CatheterConstruction:
    """Materials and measures of a catheter.

    Attributes:
        radius_m: radius of the shaft.
        electrode_m: length of the metal tip.
        rings_m: start and end of each ring, measured back from the apex.
        barium_sulphate: share of the shaft's polymer by weight.
        wall: thickness of the wall, as a share of the radius.
        braid: share of the braid's layer that is steel.
        core: share of the lumen that is copper wire.
        uneven: relative unevenness along the shaft.
    """

    radius_m: float
    electrode_m: float
    rings_m: tuple[tuple[float, float], ...]
    barium_sulphate: float
    wall: float
    braid: float
    core: float
    uneven: float


@dataclass(frozen=True, slots=True)
class Instrument:
    """Another instrument in the heart, along a smooth curve.

    Attributes:
        kind: wire, diagnostic, lead or probe; in a varied scene electrodes, wire or tube.
        radius_m: radius.
        knots: points of the curve, patient's frame.
        sway_m: (3,) way with the heart at its end, less toward its start.
        phase: lead over the heart, in shares of a beat.
        electrodes_m: start and end of each electrode, measured back from the apex; of the kind electrodes.
        barium_sulphate: share of the polymer by weight; of the kinds electrodes and tube.
    """

    kind: str
    radius_m: float
    knots: tuple[Point, ...]
    sway_m: Point
    phase: float
    electrodes_m: tuple[tuple[float, float], ...] = field(default=(), repr=False)
    barium_sulphate: float = field(default=0.0, repr=False)  # not in repr: DICOM's unique numbers follow from it


@dataclass(frozen=True, slots=True)
class Rhythm:
    """Motion of heart and breath.

    Attributes:
        heart_hz: heart rate.
        breath_hz: breathing rate.
        beat: relative change of the heart's size.
        breath_m: way of the diaphragm.
        heart_phase: phase of the heart at time 0, in shares of a cycle.
        breath_phase: phase of the breath at time 0, in shares of a cycle.
    """

    heart_hz: float
    breath_hz: float
    beat: float
    breath_m: float
    heart_phase: float
    breath_phase: float

    def breath(self, time_s: float) -> float:
        """Returns the breath from 0 (breathed out) to 1; it is out longer than in."""
        turn = 2 * math.pi * (self.breath_hz * time_s + self.breath_phase)
        return (0.5 - 0.5 * math.cos(turn)) ** 1.5

    def beating(self, time_s: float) -> float:
        """Returns the beat from 0 (filled) to 1 (emptied)."""
        turn = 2 * math.pi * (self.heart_hz * time_s + self.heart_phase)
        return 0.5 - 0.5 * math.cos(turn) + 0.1 * math.sin(2 * turn)


@dataclass(frozen=True, slots=True)
class Anatomy:
    """Measures of a patient.

    Attributes:
        spine_m: (2,) position of the spine beside and behind the heart, x and y.
        bone: relative density of the bones.
        lung: relative contrast of the lung.
        dome_m: height of the diaphragm.
        heart_size: relative size of the heart.
        sternal_wires: number of steel loops in the breastbone.
        leads: number of leads on the skin.
    """

    spine_m: tuple[float, float]
    bone: float
    lung: float
    dome_m: float
    heart_size: float
    sternal_wires: int
    leads: int


@dataclass(frozen=True, slots=True)
class XrayScene:
    """All parameters of a session's images except the catheter's shape; see `sample_xray_scene`.

    Attributes:
        seed: seed of textures and noise.
        views: the planes.
        base_axis_angle: (3,) rotation vector of the base frame in the patient's frame.
        base_m: (3,) origin of the base frame in the patient's frame.
        catheter: materials and measures of the catheter.
        devices: other instruments.
        rhythm: motion of heart and breath.
        anatomy: measures of the patient.
        variety: differences between laboratories; None: an even image without collimator, processing and table.
    """

    seed: int
    views: tuple[XrayView, ...]
    base_axis_angle: Point
    base_m: Point
    catheter: CatheterConstruction
    devices: tuple[Instrument, ...]
    rhythm: Rhythm
    anatomy: Anatomy
    variety: "XrayVariety | None" = field(default=None, repr=False)

    @property
    def patient_from_base(self) -> Pose:
        """Where the catheter's base is."""
        return Pose.from_axis_angle(self.base_axis_angle, self.base_m)

    def camera(self, view: int = 0, width: int = 512, height: int = 512) -> CameraModel:
        """Returns the true camera model of a view.

        Args:
            view: number of the view.
            width: width of the image in px.
            height: height of the image in px.

        Returns:
            The camera model; its world is the base frame.
        """
        camera = self.views[view].true.camera(width, height)
        return camera.seen_from(camera.camera_from_world @ self.patient_from_base)


def lag_weights(detector: Detector) -> FloatArray:
    """Returns the shares (1 + m,) of the light of this frame and of those before it that are read out now; sum 1.

    The mixture of exponentials is cut where less than 0.2 % is left, at 6 frames at the latest.
    """
    ages = np.arange(6)
    tail = np.sum([share * (1.0 - keep) * keep**ages for share, keep in detector.lag], axis=0)
    left = np.cumsum(tail[::-1])[::-1]
    tail = tail[left > 2e-3]
    return np.concatenate([[1.0 - tail.sum()], tail])
