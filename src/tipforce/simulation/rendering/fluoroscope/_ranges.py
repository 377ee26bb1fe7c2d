"""The settings from which a session's fluoroscopy is drawn. Ranges are (low, high): one uniform draw a session."""

from typing import Literal

from ..._ranges import NotNegative, Positive, Range, Settings, Share

__all__ = ["BIPLANE", "FLUORO", "XrayRanges"]


class XrayRanges(Settings):
    """What fluoroscopy varies over from session to session. The defaults are the preset ``fluoro``: one view."""

    planes: Literal[1, 2] = 1
    between_planes_deg: Range = (80.0, 100.0)
    calibration_px: NotNegative = 0.5
    """RMS over the working volume by which the stated calibration is off, at 512 columns."""

    primary_deg: Range = (-45.0, 45.0)
    """LAO positive."""
    secondary_deg: Range = (-15.0, 25.0)
    """Cranial positive."""
    roll_deg: Range = (-1.0, 1.0)
    source_detector_m: Range = (1.00, 1.18)
    source_object_m: Range = (0.70, 0.78)
    scale_m_per_px: Range = (0.24e-3, 0.26e-3)
    """At the isocentre, at 512 columns."""
    centre_px: Range = (-6.0, 6.0)

    photons: Range = (20.0, 500.0)
    """A pixel, detected. Drawn uniformly in its logarithm: every factor of dose is as likely."""
    pulse_s: Range = (5e-3, 10e-3)
    rate_hz: Positive = 15.0
    focal_spot_m: Range = (0.15e-3, 0.30e-3)
    """Sigma: about a third of the nominal focal spot."""
    control_s: Range = (0.2, 0.6)

    scatter: Range = (0.25, 0.8)
    """Over direct quanta, behind the grid."""
    scatter_m: Range = (20e-3, 40e-3)
    glare: Range = (0.01, 0.06)
    glare_m: Range = (30e-3, 60e-3)
    blur_px: Range = (0.45, 0.7)
    blur_tail_px: Range = (1.2, 2.2)
    blur_tail: Range = (0.1, 0.3)
    lag_fast: Range = (0.01, 0.10)
    lag_fast_keep: Range = (0.1, 0.4)
    lag_slow: Range = (0.0, 0.02)
    lag_slow_keep: Range = (0.6, 0.8)
    electronic: Range = (0.8, 3.0)
    line_noise: Range = (0.0, 0.4)
    linear_display: Share = 0.25
    """Sessions shown on a linear curve; the others on a logarithmic one."""
    log_contrast: Range = (48.0, 80.0)
    """Grey levels (of 256) for a factor e in the light."""
    linear_level: Range = (85.0, 120.0)
    """Grey level of the field's mean."""

    base_side: Literal["left", "right", "top", "bottom"] = "bottom"
    base_inset_m: Range = (-1.6e-3, -1.6e-3)
    """How far inside the first view's border the base lies; negative: beyond it. Inside, the sheath is in view."""
    base_shift_m: Range = (-10e-3, 10e-3)
    """Along that border."""
    base_turn_deg: Range = (-12.0, 12.0)
    base_tilt_deg: Range = (-8.0, 8.0)
    """Out of the first view's plane."""

    diameter_m: Range = (1.67e-3, 2.67e-3)
    electrode_m: Positive = 8e-3
    ring_m: Positive = 2e-3
    ring_gap_m: Positive = 2.5e-3
    barium_sulphate: Range = (0.18, 0.38)
    wall: Range = (0.22, 0.34)
    braid: Range = (0.2, 0.5)
    core: Range = (0.01, 0.06)
    uneven: Range = (0.0, 0.08)

    devices: tuple[int, int] = (1, 4)
    """Wires, diagnostic catheters and leads that cross the picture."""
    probe: Share = 0.12
    """Sessions with an ultrasound probe in the oesophagus."""
    sway_m: Range = (1e-3, 5e-3)
    heart_hz: Range = (1.0, 1.5)
    breath_hz: Range = (0.2, 0.3)
    breath_m: Range = (2e-3, 14e-3)
    beat: Range = (0.01, 0.05)
    spine_x_m: Range = (-45e-3, -15e-3)
    spine_y_m: Range = (62e-3, 85e-3)
    bone: Range = (0.7, 1.2)
    lung: Range = (0.5, 1.0)
    dome_m: Range = (-75e-3, -45e-3)
    heart_size: Range = (0.85, 1.2)
    sternal_wires: Share = 0.35
    leads: tuple[int, int] = (0, 3)


FLUORO = XrayRanges()
"""One view."""

BIPLANE = XrayRanges(planes=2, scatter=(0.4, 1.1))
"""Two views, 90 +- 10 degrees apart; each scatters into the other."""
