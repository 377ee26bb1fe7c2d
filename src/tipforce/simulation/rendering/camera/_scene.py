"""The scene of one session's camera: drawn once, the same for every frame."""

import math
from dataclasses import dataclass

import numpy as np

from ....geometry import CameraModel, Pose
from ....types import BasePose


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Noise of the sensor.

    Attributes:
        grey_per_electron: variance of the shot noise over the level, in grey levels.
        read_grey: standard deviation of the read noise in grey levels.

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
    """A lamp.

    Attributes:
        direction: (3,) unit vector to the lamp: right, down, to the camera.
        strength: share of all light.
    """

    direction: tuple[float, float, float]
    strength: float


@dataclass(frozen=True, slots=True)
class TubeFinish:
    """Reflection of a tube's surface; levels are of a camera at light 1, grey or (red, green, blue).

    Attributes:
        shaft: level of a polymer face turned to the camera.
        metal: level of a metal face turned to the camera.
        gloss_grey: largest level that a highlight adds.
        sharpness: exponent of the shaft's highlight.
        rim_grey: reflection of the ground at the rim (Fresnel).
        metal_sharpness: exponent of the metal's highlight.
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
    """Light of a scene.

    Attributes:
        level: overall brightness.
        gradient: relative change across the image.
        gradient_rad: direction of the gradient in the image.
        vignetting: relative loss in the corners.
        spot: relative brightness of the middle of a lamp's pool above its rim.
        spot_at: (2,) position of the pool, in shares of the image.
        ambient: share of the light from all directions.
        lamps: lamps, with the rest of the light.
        lamp_size_rad: angular size of the lamps from the table, which softens their shadows.
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
    """The weave under a shaft's polymer.

    Attributes:
        contrast: relative change of the light.
        pitch_m: length of a turn along the shaft.
        strands: number of strands over half the circumference.
    """

    contrast: float
    pitch_m: float
    strands: float


@dataclass(frozen=True, slots=True)
class CatheterAppearance:
    """Appearance of a catheter.

    Attributes:
        radius_m: radius of the shaft.
        electrode_m: length of the metal tip.
        rings_m: start and end of each ring, measured back from the apex.
        finish: reflection of polymer and metal.
        seam: darkness of the joints between metal and polymer, 0 to 1.
        wear: relative unevenness along the shaft.
        blunt: exponent of the tip's outline; 2: a dome; 6: nearly flat.
        braid: the visible braid; None: none.
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
    """Appearance of the table.

    Attributes:
        kind: one of `GROUNDS`.
        colour: colour of the surface.
        texture_grey: standard deviation of the unevenness.
        lines_grey: contrast of weave, print or holes.
        depth_m: distance below the base frame's plane.
        objects: number of objects on it.
        clear_m: smallest distance of an object from the unbent catheter's axis; 0 or less: anywhere.
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
    """A silicone pad on a plate, on a round sensor, on the arm of a stage.

    Attributes:
        colour: colour of the pad.
        mottle: relative unevenness of the pad.
        pad_m: (2,) depth and half width of the pad.
        plate_m: (2,) depth and half width of the plate.
        plate_grey: level of the plate.
        body_m: (2,) depth and half width of the sensor.
        body_grey: level of the sensor.
        arm_half_m: half width of the arm.
        arm_grey: level of the arm.
        corner_m: radius of the pad's corners.
        over_tip: the pad is taller than the catheter and hides the sunken tip, else the tip is visible on the pad.
        carrier: whether plate, sensor and arm are in view.
        rim_m: length of a rim before the face that hides the indentation (then ``over_tip`` too); 0: none.
        opacity: opacity of tissue and carrier, below 1 in fluid.
        face_radius_m: radius of the face, positive if convex, negative if concave; None: flat.
        visibility: how far tissue and carrier are visible.
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
    """A second tube in view, in the base frame's plane.

    Attributes:
        start_m: (2,) its start.
        end_m: (2,) its end.
        bow_m: largest distance of its middle from the straight line.
        sway_m: way of its end as it sways about its start.
        sway_hz: frequency of the sway.
        phase_rad: phase of the sway at time 0.
        in_front: whether it is nearer to the camera than the catheter.
        appearance: appearance of the tube.
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
    """An object in front of the shaft: a band across it.

    Attributes:
        kind: tape, bracket or cable.
        from_m: start along the base's tangent.
        to_m: end along the base's tangent.
        slant_rad: angle from the perpendicular.
        colour: colour of the band.
    """

    kind: str
    from_m: float
    to_m: float
    slant_rad: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Sheath:
    """The tube from whose mouth, at the base, the catheter comes.

    Attributes:
        appearance: appearance of the tube, without metal.
        fitting: part at its end: "", "stopper" or "clamp".
        fitting_m: length of this part.
        fitting_colour: colour of this part.
    """

    appearance: CatheterAppearance
    fitting: str
    fitting_m: float
    fitting_colour: Colour


@dataclass(frozen=True, slots=True)
class CoverPlate:
    """A plate in front of all objects, behind whose straight edge the tissue moves.

    Attributes:
        edge_m: (2,) a point of the edge in the base frame's plane.
        into_rad: angle from x to the direction away from the catheter, counter-clockwise.
        half_m: half the edge's length.
        colour: colour of the plate.
    """

    edge_m: tuple[float, float]
    into_rad: float
    half_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class SensorPipeline:
    """The steps of a camera between its sensor and its file.

    Attributes:
        mosaic: whether each pixel measures one colour (Bayer) and the others are interpolated.
        sharpen: strength of the unsharp mask.
        sharpen_px: its standard deviation.
        grey: whether the image is converted to grey at the end.
    """

    mosaic: bool
    sharpen: float
    sharpen_px: float
    grey: bool


@dataclass(frozen=True, slots=True)
class Lens:
    """Position and sharpness of the camera.

    Attributes:
        scale_m_per_px: scale in the base frame's plane, for 640 columns.
        distance_m: distance of the camera from this plane.
        base_at_m: (2,) position of the base, right and down from the middle of the image's left border.
        base_turn_rad: direction of its tangent from the image's u axis, counter-clockwise as displayed.
        yaw_rad: turn of the camera about its vertical axis, around the middle of the image.
        pitch_rad: turn about its horizontal axis, likewise.
        distortion: k1, k2, p1, p2, k3.
        blur_px: standard deviation of the blur in the base frame's plane.
        sharpest_m: height of the focus above that plane, towards the camera.
        defocus_px_per_m: blur by the distance from the focus.
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
        upright = CameraModel.facing(
            BasePose(origin, self.base_turn_rad), scale, self.distance_m, centre, self.distortion
        )
        # The camera turns about the point that it faces, at the middle of the image.
        pivot = np.array([0.0, 0.0, self.distance_m])
        turn = Pose.from_euler([self.pitch_rad, self.yaw_rad, 0.0], np.zeros(3))
        about_pivot = Pose(turn.rotation, pivot - turn.rotate(pivot))
        return upright.seen_from(about_pivot @ upright.camera_from_world)


@dataclass(frozen=True, slots=True)
class CameraScene:
    """All parameters of a session's images except those that move; `sample_scene` draws them.

    Attributes:
        seed: seed of textures and noise.
        colour: whether images are (h, w, 3) RGB, else (h, w).
        exposure_s: length of an exposure.
        jpeg_quality: JPEG quality of recorded images, 1 to 100.
        light: light of the scene.
        lens: position and sharpness of the camera.
        noise: noise of the sensor.
        catheter: appearance of the catheter.
        ground: appearance of the table.
        tissue: appearance of the tissue.
        instrument: second instrument; None: none.
        occluders: objects in front of the shaft.
        sheath: sheath around the base; None: none.
        cover: plate in front of the tissue; None: none.
        pipeline: steps from sensor to file; None: noise only.
        front_objects: number of objects out of focus between camera and catheter.
        front_blur_px: standard deviation of their blur.
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
        """Returns for each lamp (right, down, strength): shift in m of the shadow of an object ``depth_m`` above it.

        The strength is the share of all light on the ground that this lamp sends and that the shadow lacks.
        """
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
