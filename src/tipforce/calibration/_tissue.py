"""How stiff the tissue is: the force across its surface over how deep the tip presses in.

The stage moves the tissue, the image shows the tip: how deep one is in the other is known up to a constant, which is
where contact begins. In contact, with p the depth across the surface,

    F = k p^e + d dp/dt,

in which the damping d takes out what the tissue's loss adds while it is pressed. The surface is taken to lie across the
stage's forward axis; friction acts along it and does not count. In which direction that is, the sensor shows (the
inertia of what it carries); the image knows it only as well as the sensor's pose, so a turn between both is fitted: a
tip that slides five times as far as it presses in makes of one degree a tenth of the depth.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ..errors import InputError
from ..types import STAGE_FORWARD, FloatArray
from ._session import CalibrationSession

_LEAST_FRAMES = 40
_CONTACT_N = 0.03
_LEAST_PEAK_N = 0.06
"""A force that never exceeds this says nothing of the tissue."""
_INDEPENDENT_HZ = 1.0
"""So many frames a second count as independent."""
_EXPONENT_STD = 0.5
_FORCE_STD_N = 5e-3
_MOST_STEP_S = 0.15
"""Frames farther apart tell no speed."""
_POSE_STD_RAD = math.radians(0.5)
"""Of the sensor's stated angle."""
_SLIDE = 0.03
"""Of what the tip slides along the surface, so much may count as depth: direction, camera, detection of the tip."""
_LATE_STD_S = 6e-3
"""Between the stage's commands and the frames."""
_SCALE = np.array([1e-4, 0.1, 1.0, 0.2, 0.02, 1e-3])
_DEEPEST_M = 0.05
_UNIT_M = 1e-3
_MODEL = 0.02
"""Relative, of the stiffness: the plane, the surface's direction, the dome."""


@dataclass(frozen=True, slots=True, eq=False)
class TissueFit:
    """``stiffness_n_per_m``: force over depth at ``depth_m``, which is usual in contact, and its standard deviation.

    ``exponent``: of the law, 1 for a spring; ``slide``: how far the tip slides along the surface in contact, over how
    much its depth changes; ``explained``: share of the force's variance. ``depth_at_m``,
    ``force_n`` (m,): of the frames; ``law_m``, ``law_n``: the fitted curve without damping.
    """

    stiffness_n_per_m: float
    stiffness_std: float
    exponent: float
    exponent_std: float
    depth_m: float
    slide: float
    explained: float
    frames: int
    depth_at_m: FloatArray
    force_n: FloatArray
    law_m: FloatArray
    law_n: FloatArray


def fit_tissue(session: CalibrationSession) -> TissueFit:
    """The tissue's stiffness from the frames of one session.

    Raises InputError with the reason where they do not tell it: no stage, no direction of it, too little contact.
    """
    if not session.stage_names:
        raise InputError("no log of the stage: how deep the tip presses in is not known")
    forward = session.stage_names.index(STAGE_FORWARD) if STAGE_FORWARD in session.stage_names else 0
    normal = session.stage_to_base[:, forward]
    if np.isnan(normal).any():
        raise InputError("the readings do not show in which direction the stage moves (no inertia found)")
    usable = np.isfinite(session.force_n).all(axis=1)
    if usable.sum() < _LEAST_FRAMES:
        raise InputError(f"{int(usable.sum())} frames have a force, {_LEAST_FRAMES} are needed")
    frames = _Frames.of(session.subset(np.flatnonzero(usable)), forward, normal)
    force = frames.force_n
    if len(force) < _LEAST_FRAMES:
        raise InputError(f"the frames lie too far apart to tell a speed: {1.0 / _MOST_STEP_S:.0f} a second are needed")
    if np.percentile(force, 99) < _LEAST_PEAK_N or (force > _CONTACT_N).sum() < _LEAST_FRAMES:
        raise InputError("there is too little contact")
    whole, covariance = _law(frames, session.stage_angle_std_rad)
    depth = frames.depth_m(whole)
    at = float(np.median(depth[force > _CONTACT_N]))
    if not 0.0 < at < _DEEPEST_M:
        raise InputError(f"the depth of contact comes out as {1e3 * at:.3g} mm: stage and image do not belong together")
    stiffness = _secant(whole, at)
    # of the logarithm of the secant's stiffness: k p^(e - 1)
    slope = np.array([0.0, 1.0 / whole[1], 0.0, math.log(at / _UNIT_M), 0.0, 0.0])
    spread = stiffness * math.sqrt(max(float(slope @ covariance @ slope), 0.0))
    touching = force > _CONTACT_N
    slide = float(np.std(frames.along_m[touching]) / max(float(np.std(depth[touching])), 1e-5))
    residual = force - frames.model_n(whole)
    law = np.linspace(0.0, float(np.max(depth)), 60)
    return TissueFit(
        stiffness_n_per_m=stiffness,
        stiffness_std=math.hypot(spread, stiffness * math.hypot(_MODEL, _SLIDE * slide)),
        slide=slide,
        exponent=float(whole[3]),
        exponent_std=math.hypot(math.sqrt(covariance[3, 3]), _MODEL),
        depth_m=at,
        explained=float(1.0 - residual.var() / max(float(force.var()), 1e-30)),
        frames=int(touching.sum()),
        depth_at_m=depth,
        force_n=force,
        law_m=law,
        law_n=whole[1] * (law / _UNIT_M) ** whole[3],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """(n,) each: time, the stage's forward position less where contact begins, force across the surface.

    ``across_m``, ``along_m``: the dome's movement across the surface and along it, and how fast all that changes.
    """

    seconds: FloatArray
    force_n: FloatArray
    stage_m: FloatArray
    across_m: FloatArray
    along_m: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, session: CalibrationSession, forward: int, normal: FloatArray) -> "_Frames":
        seconds, force = session.seconds, session.force_n @ normal
        middle = session.dome_m - np.median(session.dome_m, axis=0)
        stage, across = session.stage_m[:, forward], middle @ normal
        along = middle @ np.array([-normal[1], normal[0]])
        # about where contact begins: a line through the frames in contact, where its force is none
        pressed = force > _CONTACT_N
        if pressed.sum() > 1:
            slope, level = np.polyfit((stage - across)[pressed], force[pressed], 1)
            stage = stage - (-level / slope if slope > 0 else float(np.min((stage - across)[pressed])))
        rates = np.vstack([session.stage_m_per_s[:, forward], np.gradient(np.stack([across, along]), seconds, axis=1)])
        kept = (np.gradient(seconds) < _MOST_STEP_S) & np.isfinite(rates).all(axis=0)
        return cls(seconds[kept], force[kept], stage[kept], across[kept], along[kept], rates[:, kept])

    def depth_m(self, law: FloatArray) -> FloatArray:
        """(n,) how deep the tip is in the tissue; 0 without contact."""
        c, s = math.cos(law[4]), math.sin(law[4])
        stage = self.stage_m - law[5] * self.rates[0]
        return np.maximum(stage - c * self.across_m - s * self.along_m - law[0], 0.0)

    def model_n(self, law: FloatArray) -> FloatArray:
        """(n,) the force.

        ``law``: where contact begins (m), N at a millimetre, N s/m, exponent, turn (rad), how late the stage is (s).
        """
        depth = self.depth_m(law)
        speed = self.rates[0] - math.cos(law[4]) * self.rates[1] - math.sin(law[4]) * self.rates[2]
        pressed = law[1] * (depth / _UNIT_M) ** law[3] + law[2] * speed
        return np.where(depth > 0.0, np.maximum(pressed, 0.0), 0.0)


def _secant(law: FloatArray, depth_m: float) -> float:
    return float(law[1] * (depth_m / _UNIT_M) ** law[3] / depth_m)


def _law(frames: _Frames, angle_std_rad: float) -> tuple[FloatArray, FloatArray]:
    """(6,): see `_Frames.model_n`, and its covariance; least squares, outliers by their size.

    Frames of one beat err alike: all together weigh as much as `_INDEPENDENT_HZ` of them a second.
    """
    force = frames.force_n
    pressed = force > _CONTACT_N
    reach = (frames.stage_m - frames.across_m)[pressed]
    slope = max(float(np.median(force[pressed] / np.maximum(reach, 1e-4))), 1.0)
    law = np.array([0.0, slope * _UNIT_M, 0.0, 1.0, 0.0, 0.0])
    turn = math.hypot(angle_std_rad, _POSE_STD_RAD)
    share = math.sqrt(min(1.0, _INDEPENDENT_HZ * float(np.ptp(frames.seconds)) / len(force)))
    std, found = _FORCE_STD_N, None
    for _ in range(2):
        root = share / std

        def wrong(law: FloatArray, root: float = root) -> FloatArray:
            off = root * (frames.model_n(law) - force)
            return np.append(off, [law[4] / turn, (law[3] - 1.0) / _EXPONENT_STD, law[5] / _LATE_STD_S])

        found = least_squares(
            wrong,
            law,
            x_scale=_SCALE,
            bounds=([-0.02, 0.0, 0.0, 0.5, -0.5, -0.05], [0.02, np.inf, np.inf, 4.0, 0.5, 0.05]),
            max_nfev=60,
        )
        law = np.asarray(found.x, np.float64)
        std = max(_FORCE_STD_N, float(np.std(frames.model_n(law) - force)))
    assert found is not None
    jacobian = found.jac * _SCALE
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * np.outer(_SCALE, _SCALE)
    return law, np.asarray(covariance, np.float64)
