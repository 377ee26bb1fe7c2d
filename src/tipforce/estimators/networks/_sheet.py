"""What is publicly known of a catheter, as the numbers that `compact` is given beside the picture."""

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ...types import KNOB, SessionInfo

__all__ = ["SHEET", "sheet_of"]

SHEET = ("log_stiffness", "log_length", "diameter", "bend")
"""Logarithms over the values below; diameter less one; the curvature that the knob asks for, times the length."""

STIFFNESS_NM2, LENGTH_M, DIAMETER_M = 4.3e-4, 0.04, 2.33e-3
"""A 7F ablation catheter 40 mm in front of its sheath."""


def sheet_of(info: SessionInfo, actuation: Mapping[str, float]) -> npt.NDArray[np.float32]:
    """(4,): `SHEET`; 0 for what is not known of the catheter.

    >>> sheet_of(SessionInfo(), {}).tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    catheter = info.catheter
    stiffness, length, diameter = catheter.bending_stiffness_nm2, catheter.flexible_length_m, catheter.diameter_m
    gain = info.actuation.knob_gain_per_m_deg
    bend = 0.0
    if gain is not None and length is not None:
        bend = gain * actuation.get(KNOB, 0.0) * length
    known = (
        math.log(stiffness / STIFFNESS_NM2) if stiffness else 0.0,
        math.log(length / LENGTH_M) if length else 0.0,
        diameter / DIAMETER_M - 1.0 if diameter else 0.0,
        bend,
    )
    return np.array(known, np.float32)
