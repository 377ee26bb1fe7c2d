"""The scene of one session's camera: drawn once, the same for every frame."""

import math
from dataclasses import dataclass

import numpy as np

from ....geometry import CameraModel, Pose
from ....types import BasePose


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """``grey_per_electron``: shot noise has this times the level as its variance; ``read_grey``: sigma of the rest.

    >>> round(SensorNoise.at_mid_grey(3.0, read_share=0.5).sigma(128.0), 6)
    3.0
    """

    grey_per_electron: float
    read_grey: float

    @classmethod
    def at_mid_grey(cls, sigma_grey: float, *, read_share: float) -> "SensorNoise":
        """Makes noise of a given standard deviation at level 128.

        Args:
            sigma_grey: standard deviation in grey levels.
            read_share: share of this standard deviation that is read noise, 0 to 1.

        Returns:
            The noise.
        """
        read = read_share * sigma_grey
        return cls((sigma_grey**2 - read**2) / 128.0, read)

    def sigma(self, level: float) -> float:
        """Returns the standard deviation at ``level`` before quantisation, in grey levels."""
        return math.sqrt(self.read_grey**2 + self.grey_per_electron * max(0.0, level))


@dataclass(frozen=True, slots=True)
class Lamp:
    """``direction`` (3,): unit vector to the lamp: right, down, to the camera. ``strength``: share of the light."""

    direction: tuple[float, float, float]
    strength: float


@dataclass(frozen=True, slots=True)
class TubeFinish:
    """Reflection of a tube's surface; levels are of a camera at light 1, grey or (red, green, blue).

    ``shaft`` and ``metal``: levels of a face turned to the camera. ``gloss_grey``: largest level that a highlight adds.
    ``sharpness``: exponent of the shaft's highlight. ``rim_grey``: reflection of the ground at the rim (Fresnel).
    """

    shaft: tuple[float, float, float]
    metal: tuple[float, float, float]
    gloss_grey: float
    sharpness: float
    rim_grey: float
    metal_sharpness: float


Colour = tuple[float, float, float]
"""Red, green, blue in grey levels at light 1."""


@dataclass(frozen=True, slots=True)
class Lighting:
    """``level``: overall; ``gradient``: relative change across the image along ``gradient_rad`` (in the image).

    ``vignetting``: loss in the corners. ``spot``: how much brighter the middle of a lamp's pool is than its rim, and
    ``spot_at``: its position, in shares of the image. ``lamps`` carry the rest of the light after ``ambient``;
    ``lamp_size_rad``: angular size of the lamps from the table, which softens their shadows.
    """

    level: float
    gradient: float
    gradient_rad: float
    vignetting: float
    spot: float
    spot_at: tuple[float, float]
    ambient: float
    lamps: tuple[Lamp, ...]
    lamp_size_rad: float


@dataclass(frozen=True, slots=True)
class Braid:
    """The weave under a shaft's polymer: how much lighter and darker, ``pitch_m`` along, ``strands`` across."""

    contrast: float
    pitch_m: float
    strands: float


@dataclass(frozen=True, slots=True)
class CatheterAppearance:
    """``radius_m``; ``electrode_m``: length of the metal tip; ``rings_m``: from, to, measured back from the apex.

    ``seam``: how dark the joints between metal and polymer are, 0..1; ``wear``: relative unevenness along the shaft.
    ``blunt``: exponent of the tip's outline, 2: a dome; 6: nearly flat.
    """

    radius_m: float
    electrode_m: float
    rings_m: tuple[tuple[float, float], ...]
    finish: TubeFinish
    seam: float
    wear: float
    blunt: float = 2.0
    braid: Braid | None = None


@dataclass(frozen=True, slots=True)
class BackgroundAppearance:
    """``kind``: board, cloth, paper or breadboard; ``depth_m``: below the base frame's plane; ``objects`` are on it.

    ``texture_grey``: standard deviation of the unevenness; ``lines_grey``: contrast of weave, print or holes.
    ``clear_m``: every object is at least this far from the unbent catheter's axis; 0 or less: anywhere.
    """

    kind: str
    colour: Colour
    texture_grey: float
    lines_grey: float
    depth_m: float
    objects: int
    clear_m: float


@dataclass(frozen=True, slots=True)
class TissueAppearance:
    """A silicone pad on a plate, on a round sensor, on the arm of a stage; sizes in metres.

    ``over_tip``: the pad is taller than the catheter and hides the sunken tip, else the tip is visible on the pad.
    ``carrier``: whether plate, sensor and arm are in view. ``rim_m``: length of a rim before the face that
    hides the indentation (then ``over_tip`` too). ``opacity``: of tissue and carrier, below 1 in fluid.
    ``face_radius_m``: positive where the face is convex, negative where it is concave. ``visibility``: how far tissue
    and carrier are visible.
    """

    colour: Colour
    mottle: float
    pad_m: tuple[float, float]
    plate_m: tuple[float, float]
    plate_grey: float
    body_m: tuple[float, float]
    body_grey: float
    arm_half_m: float
    arm_grey: float
    corner_m: float
    over_tip: bool
    carrier: bool = True
    rim_m: float = 0.0
    opacity: float = 1.0
    face_radius_m: float | None = None
    visibility: str = "in view"


@dataclass(frozen=True, slots=True)
class Instrument:
    """A second tube in view, from ``start_m`` to ``end_m`` (2,) in the base frame's plane, bent by ``bow_m``.

    It sways by ``sway_m`` about its start at ``sway_hz``. ``in_front``: nearer to the camera than the catheter.
    """

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    bow_m: float
    sway_m: float
    sway_hz: float
    phase_rad: float
    in_front: bool
    appearance: CatheterAppearance


@dataclass(frozen=True, slots=True)
class Occluder:
    """Something in front of the shaft: a band across it from ``from_m`` to ``to_m`` along the base's tangent.

    ``kind``: tape, bracket or cable; ``slant_rad`` from the perpendicular; ``colour``.
    """

    kind: str
    from_m: float
    to_m: float
    slant_rad: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Sheath:
    """The tube out of whose mouth, at the base, the catheter comes; ``appearance``: without metal.

    ``fitting``: "", "stopper" or "clamp", the part on its last ``fitting_m``, of ``fitting_colour``.
    """

    appearance: CatheterAppearance
    fitting: str
    fitting_m: float
    fitting_colour: Colour


@dataclass(frozen=True, slots=True)
class CoverPlate:
    """A plate in front of all, behind whose straight edge the tissue moves.

    ``edge_m`` (2,): a point of the edge in the base frame's plane; ``into_rad``: from x to the direction away from the
    catheter, counter-clockwise; ``half_m``: half the edge's length.
    """

    edge_m: tuple[float, float]
    into_rad: float
    half_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class SensorPipeline:
    """The steps of a camera between its sensor and its file.

    ``mosaic``: one colour a pixel (Bayer), the others interpolated. ``sharpen``: unsharp mask of this strength and of
    ``sharpen_px``. ``grey``: the image is turned to grey at the end.
    """

    mosaic: bool
    sharpen: float
    sharpen_px: float
    grey: bool


@dataclass(frozen=True, slots=True)
class Lens:
    """Position and sharpness of the camera.

    ``base_at_m`` (2,): the base, right and down from the middle of the image's left border; ``base_turn_rad``: its
    tangent from the image's u axis, counter-clockwise as displayed. ``yaw_rad``, ``pitch_rad``: the camera's turn
    about its own vertical and horizontal axes, held on the middle of the image. ``blur_px``: sigma in the base
    frame's plane; ``sharpest_m``: height of the focus above that plane (towards the camera); ``defocus_px_per_m``.
    """

    scale_m_per_px: float
    distance_m: float
    base_at_m: tuple[float, float]
    base_turn_rad: float
    yaw_rad: float
    pitch_rad: float
    distortion: tuple[float, float, float, float, float]
    blur_px: float
    sharpest_m: float
    defocus_px_per_m: float

    def camera(self, width: int = 640, height: int = 480) -> CameraModel:
        """Returns the camera model; its world is the base frame.

        Args:
            width: width of the image in px; the scale is for 640 columns and shrinks with more of them.
            height: height of the image in px.

        Returns:
            The camera model.
        """
        scale = self.scale_m_per_px * 640.0 / width
        centre = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
        origin = np.array([-0.5, centre[1]]) + np.array(self.base_at_m) / scale
        square = CameraModel.facing(
            BasePose(origin, self.base_turn_rad), scale, self.distance_m, centre, self.distortion
        )
        about = np.array([0.0, 0.0, self.distance_m])
        turn = Pose.from_euler([self.pitch_rad, self.yaw_rad, 0.0], np.zeros(3))
        held = Pose(turn.rotation, about - turn.rotate(about))
        return square.seen_from(held @ square.camera_from_world)


@dataclass(frozen=True, slots=True)
class CameraScene:
    """All parameters of a session's images but those that move; `sample_scene` draws them.

    ``colour``: images are (h, w, 3) RGB, else (h, w). ``seed``: of textures and noise. ``front_objects``: things out
    of focus between camera and catheter, blurred by ``front_blur_px``.
    """

    seed: int
    colour: bool
    exposure_s: float
    jpeg_quality: int
    light: Lighting
    lens: Lens
    noise: SensorNoise
    catheter: CatheterAppearance
    ground: BackgroundAppearance
    tissue: TissueAppearance
    instrument: Instrument | None
    occluders: tuple[Occluder, ...]
    sheath: Sheath | None = None
    cover: CoverPlate | None = None
    pipeline: SensorPipeline | None = None
    front_objects: int = 0
    front_blur_px: float = 0.0

    def camera(self, width: int = 640, height: int = 480) -> CameraModel:
        """Returns the camera model of this scene, see `Lens.camera`.

        Args:
            width: width of the image in px.
            height: height of the image in px.

        Returns:
            The camera model; its world is the base frame.
        """
        return self.lens.camera(width, height)

    def shadow_falls_m(self, depth_m: float) -> list[tuple[float, float, float]]:
        """Returns for each lamp the shift (right, down) of the shadow of an object ``depth_m`` above, and strength."""
        light = self.light
        facing = light.ambient + sum(lamp.strength * lamp.direction[2] for lamp in light.lamps)
        falls: list[tuple[float, float, float]] = []
        for lamp in light.lamps:
            right, down, up = lamp.direction
            falls.append((-depth_m * right / up, -depth_m * down / up, lamp.strength * up / facing))
        return falls

    def shadow_sigma_m(self, depth_m: float) -> float:
        """Softness of a shadow ``depth_m`` below its object: the lamp's size as a Gaussian."""
        return depth_m * math.tan(self.light.lamp_size_rad) / 2.0
