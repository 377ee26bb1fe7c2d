"""The settings from which a session's scene is drawn. Ranges are (low, high): one uniform draw a session."""

from typing import Literal

from pydantic import Field

from ..._ranges import NotNegative, Positive, Range, Settings, Share

__all__ = ["BENCH_2021", "GENERALISE", "SceneRanges"]

Ground = Literal["board", "cloth", "paper", "breadboard"]


class SceneRanges(Settings):
    """What the camera's pictures vary over from session to session. The defaults are the preset ``bench-2021``.

    Grey levels are those of a surface that faces the camera at light 1.
    """

    colour: bool = True
    """RGB pictures, as the thesis's; else grey ones."""
    exposure_s: NotNegative = 8e-3
    jpeg_quality: tuple[int, int] = (85, 95)

    scale_m_per_px: Range = (0.19e-3, 0.21e-3)
    """In the base frame's plane, at 640 columns."""
    camera_distance_m: Range = (0.35, 0.50)
    base_side: Literal["left", "right", "top", "bottom"] = "left"
    base_inset_m: float = -1.6e-3
    """How far inside the picture's border the base lies; negative: beyond it."""
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
    """Height above the base frame's plane where the focus lies; the ground lies deeper and is more blurred."""
    noise_grey: Range = (2.0, 5.0)
    """Standard deviation of shot and read noise at mid grey (128)."""
    read_noise_share: Range = (0.3, 0.7)
    """Of that standard deviation."""

    light: Range = (0.8, 1.2)
    light_gradient: Range = (0.0, 0.25)
    """Relative difference between two opposite borders."""
    light_spot: Range = (0.0, 0.15)
    """How much brighter the middle of a lamp's pool is than its rim."""
    vignetting: Range = (0.02, 0.18)
    lamps: tuple[int, int] = (1, 2)
    lamp_elevation_deg: Range = (40.0, 78.0)
    lamp_size_deg: Range = (2.0, 18.0)
    """As seen from the table: what makes shadows soft."""
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
    objects: tuple[int, int] = (1, 5)
    objects_clear_m: Range = (14e-3, 20e-3)
    """They stay this far from the unbent catheter's axis; where it is not above 0, they may lie under the catheter."""

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
    """What the silhouette mirrors of its surroundings."""
    wear: Range = (0.0, 0.08)

    tissue_colours: tuple[tuple[float, float, float], ...] = (
        (205, 150, 140), (188, 112, 104), (214, 196, 172), (196, 188, 178), (170, 96, 92),
    )  # fmt: skip
    tissue_over_tip: Share = 0.0
    """Sessions in which the phantom is so tall that it hides what the tip sinks in."""

    second_instrument: Share = 0.0
    """Sessions with another instrument in view."""
    hidden_share: Range = (0.0, 0.0)
    """Of the shaft, behind strips of tape, brackets or cables that lie across it."""


BENCH_2021 = SceneRanges()
"""The thesis's bench."""

GENERALISE = SceneRanges(
    light=(0.6, 1.4),
    light_gradient=(0.0, 0.50),
    light_spot=(0.0, 0.30),
    vignetting=(0.02, 0.34),
    lamps=(1, 3),
    lamp_elevation_deg=(25.0, 85.0),
    lamp_size_deg=(1.0, 30.0),
    ambient=(0.20, 0.85),
    grounds=("board", "cloth", "paper", "breadboard"),
    ground_grey=(120.0, 230.0),
    ground_tint=0.10,
    ground_texture_grey=(1.0, 10.0),
    ground_lines_grey=(6.0, 55.0),
    ground_depth_m=(4e-3, 60e-3),
    objects=(2, 10),
    objects_clear_m=(-12e-3, 12e-3),
    blur_px=(0.6, 2.0),
    noise_grey=(1.0, 8.0),
    shaft_grey=(20.0, 85.0),
    shaft_tint=0.5,
    metal_grey=(85.0, 195.0),
    gloss_grey=(0.0, 180.0),
    gloss_sharpness=(8.0, 160.0),
    rim_grey=(0.0, 80.0),
    wear=(0.0, 0.16),
    tissue_over_tip=0.25,
    second_instrument=1 / 3,
    hidden_share=(0.0, 0.20),
)
"""Light, ground, clutter, blur and noise twice as wide; parts of the shaft hidden; other instruments."""
