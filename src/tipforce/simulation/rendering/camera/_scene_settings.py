"""The settings of a simulated camera session, and the scene that is drawn from them.

A range is (low, high): one uniform draw a session. Ranges in the code itself are usual values, the same in all presets.
"""

import math
import operator
from typing import Literal

import numpy as np
from pydantic import Field

from ..._fields import NotNegative, Number, Positive, Range, Settings, Share, Some
from ._scene import (
    BackgroundAppearance,
    CameraScene,
    CatheterAppearance,
    Instrument,
    Lamp,
    Lens,
    Lighting,
    Occluder,
    SensorNoise,
    TissueAppearance,
    TubeFinish,
)
from ._variety import Framing, SceneVariety, tinted, vary_scene

Ground = Literal["board", "cloth", "paper", "breadboard", "printed", "metal", "room"]


class SceneRanges(Settings):
    """Ranges of the camera's images from session to session. The defaults are the preset ``bench-2021``.

    Grey levels are those of a surface that faces the camera at light 1.
    """

    colour: bool = True
    """RGB images, as the thesis's; else grey ones."""
    exposure_s: NotNegative = 8e-3
    jpeg_quality: Some = (85, 95)

    scale_m_per_px: Range = (0.19e-3, 0.21e-3)
    """In the base frame's plane, at 640 columns."""
    camera_distance_m: Range = (0.35, 0.50)
    base_side: Literal["left", "right", "top", "bottom"] = "left"
    base_inset_m: Number = -1.6e-3
    """Distance of the base inside the image's border; negative: beyond it."""
    base_shift_m: Range = (-1e-3, 1e-3)
    base_turn_deg: Range = (-2.0, 2.0)
    yaw_deg: Range = (-2.0, 2.0)
    pitch_deg: Range = (-2.0, 2.0)
    distortion_k1: Range = (-0.08, 0.08)
    """Barrel or pincushion: at the border's middle, 0.08 is 0.7 px at 0.4 m."""
    distortion_tangential: Range = (-5e-4, 5e-4)

    blur_px: Range = (0.8, 1.5)
    """Sigma of lens and pixel, in the base frame's plane, at 640 columns."""
    defocus_px_per_m: Range = (10.0, 60.0)
    sharpest_m: Range = (-8e-3, 8e-3)
    """Height of the focus above the base frame's plane; the ground is deeper and more blurred."""
    noise_grey: Range = (2.0, 5.0)
    """Standard deviation of shot and read noise at mid grey (128)."""
    read_noise_share: Range = (0.3, 0.7)
    """Share of the read noise in that standard deviation."""

    light: Range = (0.8, 1.2)
    light_gradient: Range = (0.0, 0.25)
    """Relative difference between two opposite borders."""
    light_spot: Range = (0.0, 0.15)
    """How much brighter the middle of a lamp's pool is than its rim."""
    vignetting: Range = (0.02, 0.18)
    lamps: Some = (1, 2)
    lamp_elevation_deg: Range = (40.0, 78.0)
    lamp_size_deg: Range = (2.0, 18.0)
    """Angular size from the table; it makes shadows soft."""
    ambient: Range = (0.35, 0.70)
    """Share of the light that comes from all round."""

    grounds: tuple[Ground, ...] = ("board", "board", "cloth", "paper")
    """One of these, each as likely; a name given twice is twice as likely."""
    ground_grey: Range = (165.0, 210.0)
    ground_tint: NotNegative = 0.05
    """Relative spread of red, green and blue."""
    ground_texture_grey: Range = (1.0, 5.0)
    ground_lines_grey: Range = (6.0, 30.0)
    ground_depth_m: Range = (8e-3, 40e-3)
    """Below the catheter."""
    objects: Some = (1, 5)
    objects_clear_m: Range = (14e-3, 20e-3)
    """They stay this far from the unbent catheter's axis; with 0 or less they may be under the catheter."""

    diameter_m: Positive = 2.33e-3
    electrode_m: Positive = 8e-3
    ring_m: Positive = 2e-3
    ring_gap_m: Positive = 2.5e-3
    rings: int = Field(default=3, ge=0, le=12, exclude_if=(3).__eq__)
    """Metal rings behind the electrode."""
    shaft_grey: Range = (28.0, 62.0)
    shaft_tint: NotNegative = 0.25
    metal_grey: Range = (105.0, 165.0)
    gloss_grey: Range = (15.0, 110.0)
    gloss_sharpness: Range = (15.0, 90.0)
    rim_grey: Range = (5.0, 45.0)
    """Reflection of the surroundings at the silhouette."""
    wear: Range = (0.0, 0.08)

    tissue_colours: tuple[tuple[NotNegative, NotNegative, NotNegative], ...] = (
        (205, 150, 140), (188, 112, 104), (214, 196, 172), (196, 188, 178), (170, 96, 92),
    )  # fmt: skip
    carrier: bool = Field(default=True, exclude_if=lambda shown: shown)
    """Plate, force sensor and the stage's arm behind the tissue; False: the tissue alone is in view."""
    tissue_over_tip: Share = 0.0
    """Share of sessions in which the phantom is so tall that it hides the sunken tip."""

    second_instrument: Share = 0.0
    """Sessions with another instrument in view."""
    hidden_share: Range = (0.0, 0.0)
    """Share of the shaft that is behind strips of tape, brackets or cables."""

    variety: SceneVariety | None = Field(default=None, exclude_if=operator.not_)
    """Further variation, of other people's benches."""


BENCH_2021 = SceneRanges()
"""The thesis's bench."""
GENERALISE = SceneRanges(
    light=(0.6, 1.4), light_gradient=(0.0, 0.50), light_spot=(0.0, 0.30), vignetting=(0.02, 0.34),
    lamps=(1, 3), lamp_elevation_deg=(25.0, 85.0), lamp_size_deg=(1.0, 30.0), ambient=(0.20, 0.85),
    grounds=("board", "cloth", "paper", "breadboard"), ground_grey=(120.0, 230.0), ground_tint=0.10,
    ground_texture_grey=(1.0, 10.0), ground_lines_grey=(6.0, 55.0), ground_depth_m=(4e-3, 60e-3),
    objects=(2, 10), objects_clear_m=(-12e-3, 12e-3), blur_px=(0.6, 2.0), noise_grey=(1.0, 8.0),
    shaft_grey=(20.0, 85.0), shaft_tint=0.5, metal_grey=(85.0, 195.0), gloss_grey=(0.0, 180.0),
    gloss_sharpness=(8.0, 160.0), rim_grey=(0.0, 80.0), wear=(0.0, 0.16), tissue_over_tip=0.25,
    second_instrument=1 / 3, hidden_share=(0.0, 0.20),
)  # fmt: skip
"""Light, ground, clutter, blur and noise twice as wide; parts of the shaft hidden; other instruments."""
THESIS_PLAIN = SceneRanges(
    light=(0.95, 1.05), light_gradient=(0.0, 0.03), light_spot=(0.0, 0.02), vignetting=(0.0, 0.04),
    lamps=(1, 1), lamp_elevation_deg=(70.0, 85.0), lamp_size_deg=(12.0, 18.0), ambient=(0.90, 0.98),
    grounds=("board",), ground_grey=(205.0, 225.0), ground_tint=0.02,
    ground_texture_grey=(0.0, 0.5), ground_lines_grey=(0.0, 0.0), objects=(0, 0),
    shaft_tint=0.1, metal_grey=(30.0, 60.0), gloss_grey=(0.0, 20.0), rim_grey=(0.0, 15.0), wear=(0.0, 0.02),
    tissue_colours=((232, 226, 220), (226, 222, 214)), carrier=False,
)  # fmt: skip
"""The image for which thesis algorithm 1 was written: dark shaft and tip, light even ground, light tissue, no more."""
VARIED = GENERALISE.model_copy(
    update={
        "variety": SceneVariety(),
        "grounds": ("board", "cloth", "paper", "breadboard", "printed", "metal", "room"),
        "ground_depth_m": (4e-3, 80e-3),
        "yaw_deg": (-7.0, 7.0),
        "pitch_deg": (-7.0, 7.0),
        "base_turn_deg": (-4.0, 4.0),
        "exposure_s": 8e-3,
        "jpeg_quality": (75, 98),
        "tissue_colours": (
            *GENERALISE.tissue_colours, (120, 66, 60), (232, 222, 205), (150, 150, 148), (64, 60, 58), (206, 196, 150),
        ),
        "tissue_over_tip": 0.0,
    }
)  # fmt: skip
"""Other people's benches: `SceneVariety` holds the variation beyond `GENERALISE`."""
_TURNS = {"left": 0.0, "right": math.pi, "bottom": math.pi / 2, "top": -math.pi / 2}


def sample_scene(
    ranges: SceneRanges,
    rng: np.random.Generator,
    *,
    length_m: float = 0.048,
    framing: Framing | None = None,
    catheter_rng: np.random.Generator | None = None,
) -> CameraScene:
    """Draws the scene of one session.

    Args:
        ranges: ranges from which the scene is drawn; their ``variety`` needs ``framing`` and ``catheter_rng``.
        rng: random numbers of the scene.
        length_m: length of the catheter, base to apex, along which covers and instruments are placed.
        framing: positions of catheter and tissue.
        catheter_rng: random numbers that all sessions of a catheter share.

    Returns:
        The scene.

    >>> one, two = (sample_scene(SceneRanges(), np.random.default_rng(3)) for _ in range(2))
    >>> one == two
    True
    """
    light = _lighting(ranges, rng)
    noise = SensorNoise.at_mid_grey(_of(rng, ranges.noise_grey), read_share=_of(rng, ranges.read_noise_share))
    lens = _lens(ranges, rng)
    ground = _ground(ranges, rng)
    catheter = _catheter(ranges, rng, 0.5 * ranges.diameter_m)
    tissue = _tissue(ranges, rng)
    instrument = _instrument(ranges, rng, length_m) if rng.random() < ranges.second_instrument else None
    scene = CameraScene(
        seed=int(rng.integers(2**31)),
        colour=ranges.colour,
        exposure_s=ranges.exposure_s,
        jpeg_quality=int(rng.integers(ranges.jpeg_quality[0], ranges.jpeg_quality[1] + 1)),
        light=light,
        lens=lens,
        noise=noise,
        catheter=catheter,
        ground=ground,
        tissue=tissue,
        instrument=instrument,
        occluders=_occluders(ranges, rng, length_m),
    )
    if ranges.variety is None or framing is None or catheter_rng is None:
        return scene
    return vary_scene(scene, ranges.variety, framing, rng, catheter_rng)


def _of(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(rng.uniform(*bounds))


def _lighting(ranges: SceneRanges, rng: np.random.Generator) -> Lighting:
    """Draws the light; the lamps share the light that is not ambient in random parts."""
    ambient = _of(rng, ranges.ambient)
    count = int(rng.integers(ranges.lamps[0], ranges.lamps[1] + 1))
    shares = rng.uniform(0.3, 1.0, count)
    shares *= (1.0 - ambient) / shares.sum()
    lamps: list[Lamp] = []
    for share in shares:
        elevation_rad, azimuth_rad = math.radians(_of(rng, ranges.lamp_elevation_deg)), rng.uniform(0.0, 2 * math.pi)
        across = math.cos(elevation_rad)
        direction = (across * math.cos(azimuth_rad), across * math.sin(azimuth_rad), math.sin(elevation_rad))
        lamps.append(Lamp(direction, float(share)))
    return Lighting(
        level=_of(rng, ranges.light),
        gradient=_of(rng, ranges.light_gradient),
        gradient_rad=rng.uniform(0.0, 2 * math.pi),
        vignetting=_of(rng, ranges.vignetting),
        spot=_of(rng, ranges.light_spot),
        spot_at=(rng.uniform(-0.1, 1.1), rng.uniform(-0.1, 1.1)),
        ambient=ambient,
        lamps=tuple(lamps),
        lamp_size_rad=math.radians(_of(rng, ranges.lamp_size_deg)),
    )


def _lens(ranges: SceneRanges, rng: np.random.Generator) -> Lens:
    """Draws position and sharpness of the camera; the catheter enters in the middle of the base's side, nearly."""
    scale = _of(rng, ranges.scale_m_per_px)
    # Middle of the base's side, right and down from the middle of the left border of an image of 640 x 480 px.
    right_m = {"left": 0.0, "right": 640.0, "top": 320.0, "bottom": 320.0}[ranges.base_side] * scale
    down_m = {"left": 0.0, "right": 0.0, "top": -240.0, "bottom": 240.0}[ranges.base_side] * scale
    tangent_rad = _TURNS[ranges.base_side]
    shift_m = rng.uniform(*ranges.base_shift_m, 2)
    k1 = _of(rng, ranges.distortion_k1)
    p1, p2 = rng.uniform(*ranges.distortion_tangential, 2)
    # The blur in the catheter's plane is given: at most 0.7 of it may come from defocus, the rest is the lens's own.
    blur, defocus = _of(rng, ranges.blur_px), _of(rng, ranges.defocus_px_per_m)
    sharpest = float(np.clip(_of(rng, ranges.sharpest_m), -0.7 * blur / defocus, 0.7 * blur / defocus))
    return Lens(
        scale_m_per_px=scale,
        distance_m=_of(rng, ranges.camera_distance_m),
        base_at_m=(
            right_m + ranges.base_inset_m * math.cos(tangent_rad) + shift_m[0],
            down_m - ranges.base_inset_m * math.sin(tangent_rad) + shift_m[1],
        ),
        base_turn_rad=tangent_rad + math.radians(_of(rng, ranges.base_turn_deg)),
        yaw_rad=math.radians(_of(rng, ranges.yaw_deg)),
        pitch_rad=math.radians(_of(rng, ranges.pitch_deg)),
        distortion=(k1, 0.0, float(p1), float(p2), 0.0),
        blur_px=blur,
        sharpest_m=sharpest,
        defocus_px_per_m=defocus,
    )


def _ground(ranges: SceneRanges, rng: np.random.Generator) -> BackgroundAppearance:
    """Draws kind, colour and texture of the table, its depth below the catheter, and the number of objects on it."""
    return BackgroundAppearance(
        kind=ranges.grounds[int(rng.integers(len(ranges.grounds)))],
        colour=tinted(rng, _of(rng, ranges.ground_grey), ranges.ground_tint),
        texture_grey=_of(rng, ranges.ground_texture_grey),
        lines_grey=_of(rng, ranges.ground_lines_grey),
        depth_m=_of(rng, ranges.ground_depth_m),
        objects=int(rng.integers(ranges.objects[0], ranges.objects[1] + 1)),
        clear_m=_of(rng, ranges.objects_clear_m),
    )


def _catheter(ranges: SceneRanges, rng: np.random.Generator, radius_m: float) -> CatheterAppearance:
    """Draws colours, gloss and wear of a catheter with ``radius_m``; its rings are at fixed distances from the apex."""
    pitch_m = ranges.ring_m + ranges.ring_gap_m
    first_m = ranges.electrode_m + ranges.ring_gap_m
    finish = TubeFinish(
        shaft=tinted(rng, _of(rng, ranges.shaft_grey), ranges.shaft_tint),
        metal=tinted(rng, _of(rng, ranges.metal_grey), 0.04),
        gloss_grey=_of(rng, ranges.gloss_grey),
        sharpness=_of(rng, ranges.gloss_sharpness),
        rim_grey=_of(rng, ranges.rim_grey),
        metal_sharpness=rng.uniform(6.0, 30.0),
    )
    return CatheterAppearance(
        radius_m=radius_m,
        electrode_m=ranges.electrode_m,
        rings_m=tuple((first_m + k * pitch_m, first_m + k * pitch_m + ranges.ring_m) for k in range(ranges.rings)),
        finish=finish,
        seam=rng.uniform(0.2, 0.9),
        wear=_of(rng, ranges.wear),
    )


def _tissue(ranges: SceneRanges, rng: np.random.Generator) -> TissueAppearance:
    """Draws colours and sizes of the tissue and of the parts that carry it; sizes in m, other values in grey levels."""
    colour = np.array(ranges.tissue_colours[int(rng.integers(len(ranges.tissue_colours)))])
    colour = colour * rng.uniform(0.85, 1.1) * rng.uniform(0.95, 1.05, 3)
    return TissueAppearance(
        colour=(float(colour[0]), float(colour[1]), float(colour[2])),
        mottle=rng.uniform(0.01, 0.05),
        pad_m=(rng.uniform(6e-3, 12e-3), rng.uniform(10e-3, 16e-3)),
        plate_m=(rng.uniform(2.5e-3, 5e-3), rng.uniform(14e-3, 20e-3)),
        plate_grey=rng.uniform(60, 170),
        body_m=(rng.uniform(9e-3, 16e-3), rng.uniform(10e-3, 20e-3)),
        body_grey=rng.uniform(110, 185),
        arm_half_m=rng.uniform(4e-3, 10e-3),
        arm_grey=rng.uniform(45, 180),
        corner_m=rng.uniform(0.5e-3, 2.5e-3),
        over_tip=bool(rng.random() < ranges.tissue_over_tip),
        carrier=ranges.carrier,
    )


def _instrument(ranges: SceneRanges, rng: np.random.Generator, length_m: float) -> Instrument:
    """Draws an instrument from beyond the image's border to a point near the catheter of ``length_m``, or across it."""
    # It comes from the side: at least 45 degrees from the catheter's base tangent.
    direction_rad = rng.uniform(0.25 * math.pi, 0.75 * math.pi) * rng.choice([-1.0, 1.0])
    direction = np.array([math.cos(direction_rad), math.sin(direction_rad)])
    end = np.array([rng.uniform(0.2, 1.6) * length_m, 0.0]) + direction * rng.uniform(-12e-3, 25e-3)
    start = end + direction * 110e-3  # beyond the border of any image
    return Instrument(
        start_m=(float(start[0]), float(start[1])),
        end_m=(float(end[0]), float(end[1])),
        bow_m=rng.uniform(-12e-3, 12e-3),
        sway_m=rng.uniform(0.0, 4e-3),
        sway_hz=rng.uniform(0.2, 1.5),
        phase_rad=rng.uniform(0.0, 2 * math.pi),
        in_front=bool(rng.random() < 0.4),
        appearance=_catheter(ranges, rng, rng.uniform(0.5e-3, 1.6e-3)),
    )


def _occluders(ranges: SceneRanges, rng: np.random.Generator, length_m: float) -> tuple[Occluder, ...]:
    """Draws one to three bands that together hide about the drawn share of the catheter, which is ``length_m`` long."""
    share = _of(rng, ranges.hidden_share)
    if share <= 0.0:
        return ()
    count = int(rng.integers(1, 4))
    widths_m = rng.dirichlet(np.full(count, 4.0)) * share * length_m
    occluders: list[Occluder] = []
    for width_m in widths_m:
        kind = "cable" if width_m < 3e-3 else str(rng.choice(["tape", "bracket"]))
        colour = tinted(rng, rng.uniform(30, 215), 0.25)
        middle_m = rng.uniform(0.08, 0.80) * length_m
        start_m, end_m = middle_m - 0.5 * width_m, middle_m + 0.5 * width_m
        occluders.append(Occluder(kind, start_m, end_m, rng.uniform(-0.35, 0.35), colour))
    return tuple(occluders)
