"""Contact in the stretch that gives the tare: the whole session would be off by the force of that contact.

The log alone shows it where the force changes in the stretch as it does elsewhere, or where the stage seems to carry
much more than it does: in contact the force follows the stage's position. Images show it where the tissue would pull at
the tip for most of the session: tissue only pushes.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from ..errors import InputError
from ..io import Inertia, Tare
from ..plausibility import ForceFinding
from ..types import FloatArray, IntArray
from ..vision import DetectedShape
from ._find import ForceCorrections, find_tare_and_inertia
from ._inertia import StageMotion, carried_n

_SMOOTH_S = 0.02
_SPREAD = (5.0, 95.0)
_MIN_CHANGE_N = 0.03
_MAX_CHANGE, _MAX_CHANGE_NO_STAGE = 0.25, 0.6
"""Largest change of the force in the stretch, as a share of that elsewhere. With the stage's log taken out it is 0.01
to 0.16 in 35 clean simulated sessions and 0.2 to 1.1 in stretches of contact."""
_MAX_MASS = 1.6
"""Largest carried mass that is found, as a share of the stated one: 0.8 to 1.24 in the clean sessions; contact gives
more than 1.6, and shows more than the least change, wherever the force changes by less than the share above."""
_MIN_PULL, _MIN_PULL_N, _MIN_FRAMES = 0.35, 0.03, 50
"""Least share of pull along the tip's axis in the sum of all forces, least mean force, and least number of images. Pure
push is -1; friction on a wall along the shaft gives at most 0.3."""
_AT_TARE_N, _MAX_AT_TARE = 0.03, 0.05
"""A force that comes back to the level of the tare for more than this share of the time does not pull because of it."""
_TIP_SHARE = 0.15
_TRIED_S = 2.0
"""Length of the stretches that are tried in place of one with contact."""


def changing_tare(
    stamps: IntArray,
    force: FloatArray,
    stage: StageMotion,
    tare: Tare,
    inertia: Inertia,
    moving_mass_kg: float | None,
) -> ForceFinding | None:
    """Finds contact during the tare, as the log alone shows it.

    Args:
        stamps: (n,) stamps of the readings.
        force: (n, 3) readings, N, NaN where they are not used.
        stage: movement of the stage.
        tare: the tare with its stretches.
        inertia: the mass that was found in them.
        moving_mass_kg: the stated mass, or None.

    Returns:
        The finding, or None.
    """
    seconds = (stamps - stamps[0]) * 1e-9
    inside = tare.covers(seconds)
    axes = ~np.isnan(force).all(axis=0)
    finite = np.isfinite(force[:, axes]).all(axis=1)
    if not stage.names and moving_mass_kg and inertia.how != "estimated":  # contact looks like that mass
        return None
    carried = np.broadcast_to(carried_n(stage, inertia, stamps), force.shape)[finite][:, axes]
    remainder = force[finite][:, axes] - carried
    inside, outside = inside[finite], ~inside[finite]
    if inside.sum() < 10 or outside.sum() < 10:
        return None
    period = max(float(np.median(np.diff(seconds))), 1e-6)
    smooth = uniform_filter1d(remainder, max(1, round(_SMOOTH_S / period)), axis=0, mode="nearest")
    change, elsewhere = _spread(smooth[inside]), _spread(smooth[outside])
    share = _MAX_CHANGE if stage.names else _MAX_CHANGE_NO_STAGE
    if change > max(_MIN_CHANGE_N, share * elsewhere):
        detail = f"the force changes by {change:.3f} N in the stretch of the tare, and by {elsewhere:.3f} N elsewhere"
        if not stage.names:
            detail += " (if the sensor rides on a moving stage, import the stage's log too)"
        return _finding(tare, change, detail)
    heaviest = float(np.linalg.norm(inertia.gain_kg, axis=1).max(initial=0.0))
    if moving_mass_kg and heaviest > _MAX_MASS * moving_mass_kg and _spread(carried[inside]) > _MIN_CHANGE_N:
        return _finding(
            tare,
            change,
            f"the force follows the stage in the stretch of the tare as if it carried {1e3 * heaviest:.0f} g, and "
            f"sensor.moving_mass_kg states {1e3 * moving_mass_kg:.0f} g",
        )
    return None


def pulling_force(
    frame_ns: IntArray, shapes: Sequence[DetectedShape], stamps: IntArray, force: FloatArray, facts: ForceCorrections
) -> ForceFinding | None:
    """Finds contact during the tare, as the images show it: with this tare the tissue pulls at the tip.

    The clock offset may be unknown: the sum over the session is nearly the same for all offsets.

    Args:
        frame_ns: (n,) stamps of the images.
        shapes: (n) shapes in them.
        stamps: (m,) stamps of the readings.
        force: (m, 3) readings, N, NaN where they are not used.
        facts: tare, inertia and pose of the sensor.

    Returns:
        The finding with the force that the tissue would pull with, or None.
    """
    axes = np.flatnonzero(~np.isnan(force).all(axis=0)).tolist()
    usable = np.isfinite(force[:, axes]).all(axis=1)
    if axes[:2] != [0, 1] or facts.sensor is None or len(shapes) < _MIN_FRAMES:
        return None
    begin_ns, stamps = stamps[0], stamps[usable]
    tared = np.nan_to_num(force[usable] - facts.tare.force_n - facts.carried(stamps))
    outside = ~facts.tare.covers((stamps - begin_ns) * 1e-9)
    at_tare = np.linalg.norm(tared[outside, :2], axis=1) < _AT_TARE_N
    if float(np.mean(at_tare)) > _MAX_AT_TARE:
        return None
    base = tared @ facts.sensor.matrix.T
    at_frames = np.stack([np.interp(frame_ns, stamps, base[:, axis]) for axis in range(2)], axis=1)
    tips = np.array([_tip_direction(shape) for shape in shapes])
    covered = np.isfinite(tips).all(axis=1) & (frame_ns >= stamps[0]) & (frame_ns <= stamps[-1])
    if covered.sum() < _MIN_FRAMES:
        return None
    along = np.sum(tips[covered] * at_frames[covered], axis=1)
    sizes = np.linalg.norm(at_frames[covered], axis=1)
    if sizes.mean() < _MIN_PULL_N or along.sum() < _MIN_PULL * sizes.sum():
        return None
    pull_n = float(np.percentile(along, 95))
    return _finding(
        facts.tare,
        pull_n,
        f"with this tare the tissue would pull at the tip with up to {pull_n:.2f} N, but tissue only pushes (if the "
        "stretch is right, check sensor.reads and sensor.angle_deg)",
    )


def contact_free_stretch(
    stamps: IntArray, force: FloatArray, stage: StageMotion, moving_mass_kg: float | None
) -> tuple[float, float] | None:
    """Finds the first stretch of the log that can serve as a tare.

    Args:
        stamps: (n,) stamps of the readings in ns.
        force: (n, 3) readings in N.
        stage: movement of the stage; empty without its log.
        moving_mass_kg: mass that the sensor carries; None: not stated.

    Returns:
        Start and end in seconds since the log's first row; None if there is no such stretch.
    """
    last_s = float(stamps[-1] - stamps[0]) * 1e-9
    for start in np.arange(0.0, last_s - _TRIED_S, _TRIED_S).tolist():
        stretch = (start, start + _TRIED_S)
        try:
            tare, inertia = find_tare_and_inertia(stamps, force, stage, stretch, [], moving_mass_kg)
        except InputError:  # too few readings that are used
            continue
        shows_stage = inertia.how == "estimated" or not stage.names
        if shows_stage and changing_tare(stamps, force, stage, tare, inertia, moving_mass_kg) is None:
            return stretch
    return None


def _finding(tare: Tare, size_n: float, detail: str) -> ForceFinding:
    start, end = tare.stretches_s[0]
    return ForceFinding("contact during tare", start, end, size_n=size_n, detail=detail)


def _spread(values: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(np.percentile(values, _SPREAD, axis=0), axis=0)))


def _tip_direction(shape: DetectedShape) -> FloatArray:
    """Returns the unit vector (2,) along the tip's axis, base frame; NaN where nothing was detected."""
    if shape.centreline is None or shape.base is None:
        return np.full(2, math.nan)
    points = shape.base.to_base(shape.centreline.points)
    axis = points[-1] - points[int((1.0 - _TIP_SHARE) * (len(points) - 1))]
    return axis / max(float(np.linalg.norm(axis)), 1e-12)
