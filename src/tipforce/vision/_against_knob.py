"""Detects a mirrored image: the shaft at rest then bends against the direction of the knob."""

import math
from collections.abc import Sequence

import numpy as np

from ..types import Image, SessionInfo
from ._session_size import for_session
from ._settings import ResolvedVision
from .tracer import Tracer

REST_RADIUS_PX = 1.5
"""A shaft whose tip is within this radius is at rest: noise moves it by some tenths of a pixel."""
_REST_SHARE, _LEAST = 0.25, 4
"""It must rest in this share of the images and in so many, while it moves in others: tissue in contact moves it."""
_MOVES_PX = 5.0
_LEAST_TURN_RAD = 0.1
"""A smaller asked turn may be hidden by a shaft that is not straight by itself."""
_AGAINST = 0.5
"""The turn is against the knob where it is opposite, and so large a share of the asked one."""


def bends_against_knob(
    vision: ResolvedVision, images: Sequence[Image], info: SessionInfo, asked_per_m: float
) -> str:  # fmt: skip
    """Returns why ``images`` of one session do not go with the knob, "" where nothing says so.

    A catheter that moves now and then and rests between is free where it rests; then it bends as the knob asks. Without
    such rest, or without a stated flexible length, nothing can be said: a mirrored catheter is a catheter, too.

    Args:
        vision: the detection, calibrated on the session.
        images: from all over the session, in a plane that the catheter bends in.
        info: its metadata.
        asked_per_m: curvature in 1/m that the knob asks for, the same in all images; counter-clockwise in the displayed
            image, from the base to the tip, is positive.
    """
    length = info.catheter.flexible_length_m
    if length is None or abs(asked_per_m * length) < _LEAST_TURN_RAD:
        return ""
    tracer = Tracer(for_session(vision, info))
    lines = [shape.centreline.points for shape in map(tracer.detect, images) if shape.centreline is not None]
    if len(lines) < _LEAST:
        return ""
    tips = np.array([line[-1] for line in lines])
    apart = np.linalg.norm(tips[:, None] - tips, axis=2)
    near = apart < REST_RADIUS_PX
    at = int(near.sum(axis=1).argmax())
    rest = np.flatnonzero(near[at])
    if len(rest) < max(_LEAST, _REST_SHARE * len(images)) or apart[at].max() < _MOVES_PX:
        return ""
    asked, turn = asked_per_m * length, float(np.median([_turn_rad(lines[k]) for k in rest]))
    if turn / asked > -_AGAINST:
        return ""
    return (
        f"where it rests the shaft bends by {math.degrees(turn):+.0f} degrees, and the knob asks for "
        f"{math.degrees(asked):+.0f}: the images are mirrored, or knob_gain_per_m_deg has the wrong sign"
    )


def _turn_rad(points: np.ndarray) -> float:
    """Counter-clockwise turn in the displayed image of (n, 2) points, from the base to the tip."""
    steps = np.diff(points, axis=0)
    angle = np.unwrap(np.arctan2(-steps[:, 1], steps[:, 0]))
    return float(angle[-1] - angle[0])
