"""Finds the stiffness of the tissue: the force across its surface over the indentation by the tip.

The stage moves the tissue, the image shows the tip: so the indentation is known up to a constant, the position at which
contact begins. In contact, with p the indentation,

    F = k p^e + d dp/dt,

where the damping d describes the tissue's loss during indentation. The surface is assumed to be perpendicular to the
stage's forward axis; friction acts along it and has no effect. The sensor shows that direction (by the inertia of the
mass that it carries); the image knows it only as well as the sensor's pose, so a turn between both is fitted: if the
tip slides five times as far as it is pressed in, one degree changes the indentation by a tenth.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ..errors import InputError
from ..types import STAGE_FORWARD, FloatArray
from ._session import CalibrationSession

MIN_FRAMES = 40
MIN_CONTACT_N = 0.03
MIN_PEAK_N = 0.06
"""Least peak of the force; a smaller force does not determine the tissue."""
INDEPENDENT_HZ = 1.0
"""Number of frames per second that count as independent."""
_EXPONENT_STD = 0.5
"""Standard deviation of the exponent about 1, before the fit."""
MIN_FORCE_STD_N = 5e-3
MAX_STEP_S = 0.15
"""Frames that are farther apart do not determine a speed."""
POSE_STD_RAD = math.radians(0.5)
"""Standard deviation of the sensor's stated angle."""
SLIDE_SHARE = 0.03
"""Share of the sliding that may appear as indentation: errors of direction, camera, and detection of the tip."""
DELAY_STD_S = 6e-3
"""Standard deviation of the time between the stage's commands and the frames."""
_SCALE = np.array([1e-4, 0.1, 1.0, 0.2, 0.02, 1e-3])
"""Typical changes of the law's six values; see `_Frames.model_n`."""
MAX_DEPTH_M = 0.05
_UNIT_M = 1e-3
MODEL_SHARE = 0.02
"""Relative model error of the stiffness: the plane, the surface's direction, the dome."""


@dataclass(frozen=True, slots=True, eq=False)
class TissueFit:
    """Fitted law of the tissue.

    Attributes:
        stiffness_n_per_m: force over indentation at ``depth_m``.
        stiffness_std: its standard deviation.
        exponent: exponent of the law, 1 for a spring.
        exponent_std: its standard deviation.
        depth_m: median of the indentation in contact.
        slide: standard deviation of the sliding along the surface in contact, over that of the indentation.
        explained: explained share of the force's variance.
        frames: number of frames in contact.
        depth_at_m: (m,) indentation of the frames.
        force_n: (m,) force of the frames.
        law_m: indentations of the fitted curve.
        law_n: forces of the fitted curve, without damping.
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
    """Finds the tissue's stiffness from the frames of one session.

    Raises:
        InputError: the frames do not determine it: no stage, no direction of it, too little contact.
    """
    if not session.stage_names:
        raise InputError("no log of the stage: the indentation is not known")
    forward = session.stage_names.index(STAGE_FORWARD) if STAGE_FORWARD in session.stage_names else 0
    normal = session.stage_to_base[:, forward]
    if np.isnan(normal).any():
        raise InputError("the readings do not show in which direction the stage moves (no inertia found)")
    usable = np.isfinite(session.force_n).all(axis=1)
    if usable.sum() < MIN_FRAMES:
        raise InputError(f"{int(usable.sum())} frames have a force, {MIN_FRAMES} are needed")
    frames = _Frames.of(session.subset(np.flatnonzero(usable)), forward, normal)
    force = frames.force_n
    if len(force) < MIN_FRAMES:
        raise InputError(
            f"the frames are too far apart to determine a speed: {1.0 / MAX_STEP_S:.0f} per second are needed"
        )
    if np.percentile(force, 99) < MIN_PEAK_N or (force > MIN_CONTACT_N).sum() < MIN_FRAMES:
        raise InputError("there is too little contact")
    law, covariance = _law(frames, session.stage_angle_std_rad)
    depth = frames.depth_m(law)
    median_depth_m = float(np.median(depth[force > MIN_CONTACT_N]))
    if not 0.0 < median_depth_m < MAX_DEPTH_M:
        raise InputError(
            f"the depth of contact would be {1e3 * median_depth_m:.3g} mm: stage and image do not belong together"
        )
    stiffness = _secant(law, median_depth_m)
    # slope of the logarithm of the secant's stiffness, k p^(e - 1)
    slope = np.array([0.0, 1.0 / law[1], 0.0, math.log(median_depth_m / _UNIT_M), 0.0, 0.0])
    fit_std = stiffness * math.sqrt(max(float(slope @ covariance @ slope), 0.0))
    touching = force > MIN_CONTACT_N
    slide = float(np.std(frames.along_m[touching]) / max(float(np.std(depth[touching])), 1e-5))
    residual = force - frames.model_n(law)
    curve_m = np.linspace(0.0, float(np.max(depth)), 60)
    return TissueFit(
        stiffness_n_per_m=stiffness,
        stiffness_std=math.hypot(fit_std, stiffness * math.hypot(MODEL_SHARE, SLIDE_SHARE * slide)), slide=slide,
        exponent=float(law[3]), exponent_std=math.hypot(math.sqrt(covariance[3, 3]), MODEL_SHARE),
        depth_m=median_depth_m, explained=float(1.0 - residual.var() / max(float(force.var()), 1e-30)),
        frames=int(touching.sum()), depth_at_m=depth, force_n=force, law_m=curve_m,
        law_n=law[1] * (curve_m / _UNIT_M) ** law[3],
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """The frames in use.

    Attributes:
        seconds: (n,) times.
        force_n: (n,) force across the surface.
        stage_m: (n,) the stage's forward position less that at the beginning of contact.
        across_m: (n,) position of the dome across the surface.
        along_m: (n,) position of the dome along the surface.
        rates: (3, n) rates of ``stage_m``, ``across_m`` and ``along_m``, in m/s.
    """

    seconds: FloatArray
    force_n: FloatArray
    stage_m: FloatArray
    across_m: FloatArray
    along_m: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, session: CalibrationSession, forward: int, normal: FloatArray) -> "_Frames":
        """Returns the frames that determine a speed.

        Args:
            session: frames with a force.
            forward: index of the stage's axis that presses the tissue against the tip.
            normal: (2,) unit vector of this axis in the base frame.
        """
        seconds, force = session.seconds, session.force_n @ normal
        middle = session.dome_m - np.median(session.dome_m, axis=0)
        stage, across = session.stage_m[:, forward], middle @ normal
        along = middle @ np.array([-normal[1], normal[0]])
        # position at the beginning of contact: the zero of a line through the frames in contact
        pressed = force > MIN_CONTACT_N
        if pressed.sum() > 1:
            slope, level = np.polyfit((stage - across)[pressed], force[pressed], 1)
            stage = stage - (-level / slope if slope > 0 else float(np.min((stage - across)[pressed])))
        rates = np.vstack([session.stage_m_per_s[:, forward], np.gradient(np.stack([across, along]), seconds, axis=1)])
        kept = (np.gradient(seconds) < MAX_STEP_S) & np.isfinite(rates).all(axis=0)
        return cls(seconds[kept], force[kept], stage[kept], across[kept], along[kept], rates[:, kept])

    def depth_m(self, law: FloatArray) -> FloatArray:
        """Returns the (n,) indentation in m; 0 without contact."""
        c, s = math.cos(law[4]), math.sin(law[4])
        stage = self.stage_m - law[5] * self.rates[0]
        return np.maximum(stage - c * self.across_m - s * self.along_m - law[0], 0.0)

    def model_n(self, law: FloatArray) -> FloatArray:
        """Returns the (n,) force: a power of the indentation, plus damping times its rate; 0 without contact.

        The delay of the stage counts for the indentation, not for its rate.

        Args:
            law: (6,) stage position at the beginning of contact (m), force at a millimetre (N), damping (N s/m),
                exponent, turn (rad), delay of the stage (s).
        """
        depth = self.depth_m(law)
        stage_speed, across_speed, along_speed = self.rates
        speed = stage_speed - math.cos(law[4]) * across_speed - math.sin(law[4]) * along_speed  # of the indentation
        pressed = law[1] * (depth / _UNIT_M) ** law[3] + law[2] * speed
        return np.where(depth > 0.0, np.maximum(pressed, 0.0), 0.0)


def _secant(law: FloatArray, depth_m: float) -> float:
    """Returns the force over the indentation at ``depth_m``, N/m."""
    return float(law[1] * (depth_m / _UNIT_M) ** law[3] / depth_m)


def _law(frames: _Frames, angle_std_rad: float) -> tuple[FloatArray, FloatArray]:
    """Returns the (6,) law (see `_Frames.model_n`) and its covariance: least squares, with the noise fitted.

    The errors of frames of one beat are similar: all together have the weight of `INDEPENDENT_HZ` frames per second.
    """
    force = frames.force_n
    pressed = force > MIN_CONTACT_N
    reach = (frames.stage_m - frames.across_m)[pressed]
    slope = max(float(np.median(force[pressed] / np.maximum(reach, 1e-4))), 1.0)
    law = np.array([0.0, slope * _UNIT_M, 0.0, 1.0, 0.0, 0.0])
    turn = math.hypot(angle_std_rad, POSE_STD_RAD)
    share = math.sqrt(min(1.0, INDEPENDENT_HZ * float(np.ptp(frames.seconds)) / len(force)))
    std, found = MIN_FORCE_STD_N, None
    for _ in range(2):  # the second fit uses the noise that the first one found
        root = share / std

        def residuals(law: FloatArray, root: float = root) -> FloatArray:
            difference = root * (frames.model_n(law) - force)
            return np.append(difference, [law[4] / turn, (law[3] - 1.0) / _EXPONENT_STD, law[5] / DELAY_STD_S])

        found = least_squares(
            residuals, law, x_scale=_SCALE,
            bounds=([-0.02, 0.0, 0.0, 0.5, -0.5, -0.05], [0.02, np.inf, np.inf, 4.0, 0.5, 0.05]), max_nfev=60,
        )  # fmt: skip
        law = np.asarray(found.x, np.float64)
        std = max(MIN_FORCE_STD_N, float(np.std(frames.model_n(law) - force)))
    assert found is not None
    jacobian = found.jac * _SCALE  # in similar units, so that the pseudo-inverse omits no small unknown
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * np.outer(_SCALE, _SCALE)
    return law, np.asarray(covariance, np.float64)
