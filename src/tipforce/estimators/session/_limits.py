"""Unknowns that limit the force: the part of its variance that goes away when a group of unknowns is measured.

For a line in contact the session model has a joint Gaussian of the force and all unknowns: the moments over the nodes
of the walk. With the force's magnitude along ``u``, its variance is ``u' C u``. A measurement of the unknowns of a
group adds the information ``1 / left^2 - 1 / prior^2`` on each of them: the standard deviation that the measurement
leaves replaces that of the prior. This conditions the Gaussian, as for a Kalman update with a measurement of that
variance. The contribution of a group is the square root of the variance that goes away. Groups share variance where
the shape shows only their sum, so that their squares do not add up to the whole.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...mechanics.planar import FORCE, UNKNOWNS
from ...types import FloatArray
from ._filter import SessionFilter
from ._knowledge import STIFFNESS_LEFT_OUT
from ._line_error import MODES
from ._state import CAMERA, COUNT, GAIN, K0, PLAY, ROD

MIN_CONTACT = 0.9
"""A frame counts if its probability of contact is larger."""
MIN_FRAMES = 3
"""With fewer frames in contact there is no answer."""
MIN_SHOWN_SHARE = 0.1
"""A group is shown if at least this share of the variance goes away."""
_LEFT_SHARE = 1e-3
"""A measurement leaves this share of the prior's standard deviation, if nothing else is known of it."""
_MAX_FRAMES = 1000
"""With more frames only every second, fourth ... one is kept."""


@dataclass(frozen=True, slots=True)
class UnknownGroup:
    """Unknowns that one measurement determines.

    Attributes:
        name: name for people.
        unknowns: their indices in the session's state.
        remedy: half a sentence on how to measure them; ``{view}`` is the name of the view.
        left: standard deviation of each that the best measurement leaves; None: next to nothing.
    """

    name: str
    unknowns: tuple[int, ...]
    remedy: str
    left: float | None = None


def _rod(*names: str) -> tuple[int, ...]:
    return tuple(UNKNOWNS.index(name) for name in names)


_CAMERA = ROD + MODES
GROUPS = (
    UnknownGroup(
        "knob map",
        (GAIN, PLAY),
        "measure the knob map with `tipforce calibrate` (actuation.knob_gain_per_m_deg and knob_play_deg) and state "
        "knob_gain_uncertainty",
    ),
    UnknownGroup(
        "curvature without load",
        (K0,),
        "record some seconds without contact before the tip touches, and again after the knob has turned",
    ),
    UnknownGroup(
        "camera tilt",
        _rod("tilt_x_per_m", "tilt_y_per_m"),
        "align the camera with the plane of bending and state views.{view}.tilt_uncertainty_deg",
    ),
    UnknownGroup(
        "bend toward the camera",
        tuple(range(_CAMERA, _CAMERA + CAMERA)),
        "align the camera with the plane of bending and set prior.stretch to 4e-4 and prior.depth_per_m to 0.01",
    ),
    UnknownGroup(
        "image scale",
        _rod("scale"),
        "measure views.{view}.metres_per_px with `tipforce calibrate`, from a ruler or a board, which also states "
        "metres_per_px_uncertainty",
    ),
    UnknownGroup(
        "lens",
        _rod("distortion_per_m2"),
        "take a lens that keeps straight lines straight and state it with prior.distortion_per_m2 = 0.03",
    ),
    UnknownGroup(
        "clamp",
        _rod("base_x_m", "base_y_m", "base_angle_rad"),
        "let the border of the image cut the shaft at the clamp, perpendicular to it, and state how well with "
        "prior.base_position_m = 5e-4 and prior.base_angle_deg = 0.5",
    ),
    UnknownGroup(
        "stiffness",
        _rod("stiffness"),
        "measure catheter.bending_stiffness_nm2 with `tipforce calibrate` and a recording with forces, which also "
        "states bending_stiffness_uncertainty",
        STIFFNESS_LEFT_OUT,
    ),
    UnknownGroup(
        "stiffness along the shaft",
        _rod("proximal_stiffness", "stiffening_m2"),
        "measure catheter.stiffness_profile with `tipforce calibrate` and a recording with forces, and state how well "
        "with prior.proximal_stiffness = 0.01",
    ),
    UnknownGroup(
        "length", _rod("length"), "measure catheter.flexible_length_m and state catheter.flexible_length_uncertainty"
    ),
    UnknownGroup(
        "creep",
        _rod("creep"),
        "measure by how much the bend grows under a steady force and state it with "
        "prior.creep = 0.02 and prior.creep_std = 0.005",
    ),
)
"""Groups that a measurement determines."""
LINE_ERROR = UnknownGroup(
    "error of the line", tuple(range(ROD, ROD + MODES)), "take a sharper or larger image of the catheter"
)
SHAPE = UnknownGroup(
    "the shape itself",
    (),
    "push at an angle to the tip's axis: the shape shows a force along the axis least; `fusion` reads the "
    "image at the tip, too",
)
"""Not measurable: left when all groups are known, in the direction that the shape shows least; friction at the tip is
a part."""


@dataclass(frozen=True, slots=True)
class Limit:
    """Contribution of one group, from the medians of the standard deviations over the frames.

    Attributes:
        name: name of the group.
        std_n: standard deviation of the force's magnitude that goes away when the group alone is known, N.
        left_n: standard deviation that is left when this group and those before it in the table are known, N.
        remedy: half a sentence on how to measure the group, or else to reduce its contribution.
    """

    name: str
    std_n: float
    left_n: float
    remedy: str


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """The unknowns that limit the force in a session.

    Attributes:
        frames: number of frames in contact.
        std_n: standard deviation of the force's magnitude in them, N, median; NaN in too few frames.
        measurable: the groups that a measurement determines, the largest contribution first.
        others: error of the line, and the limit of the shape itself.
    """

    frames: int
    std_n: float
    measurable: tuple[Limit, ...] = ()
    others: tuple[Limit, ...] = ()

    @property
    def limits(self) -> tuple[Limit, ...]:
        """All groups, the largest contribution first."""
        return tuple(sorted((*self.measurable, *self.others), key=lambda each: -each.std_n))

    def text(self) -> str:
        """Returns one sentence: the contributions that count, and how to reduce the largest ones."""
        if not self.measurable:
            return (
                f"{self.frames} frames in contact that the rod explains: too few to find their limit; "
                f"expected at least {MIN_FRAMES}"
            )
        limits = self.limits
        first, *rest = [limit for limit in limits if self._counts(limit)] or limits[:1]
        parts = [f"{first.name} {1e3 * first.std_n:.0f} mN", *(f"{each.name} {1e3 * each.std_n:.0f}" for each in rest)]
        remedies = [first.remedy]
        measurable = self.measurable[0]  # the largest contribution may be one that no measurement reduces
        if measurable is not first and self._counts(measurable):
            remedies.append(measurable.remedy)
        return f"{', '.join(parts)}: {'; and '.join(remedies)}"

    def _counts(self, limit: Limit) -> bool:
        return limit.std_n**2 >= MIN_SHOWN_SHARE * self.std_n**2

    def lines(self) -> list[str]:
        """Returns the sentence of `text`, and a table with a row for each group."""
        if not self.measurable:
            return [self.text()]
        width = max(len(each.name) for each in self.limits)
        rows = [
            f"{each.name.ljust(width)}  {1e3 * each.std_n:9.1f}{1e3 * each.left_n:14.1f}" for each in self.measurable
        ]
        rows += [f"{each.name.ljust(width)}  {1e3 * each.std_n:9.1f}" for each in self.others]
        return [
            f"the force is limited by {self.text()}",
            f"its standard deviation in {self.frames} frames in contact is {1e3 * self.std_n:.0f} mN (median); in mN:",
            f"{''.ljust(width)}  goes away when     left when this and",
            f"{'unknown'.ljust(width)}  this is known   all above are known",
            *rows,
        ]

    def figures(self) -> dict[str, Any]:
        """Returns JSON values; None where there is no answer."""
        return {
            "frames": self.frames,
            "std_n": self.std_n if math.isfinite(self.std_n) else None,
            "measurable": [asdict(each) for each in self.measurable],
            "others": [asdict(each) for each in self.others],
        }


class LimitsTally:
    """Collects the Gaussians of frames in contact of one or more sessions; `add` takes a filter after its step."""

    def __init__(self) -> None:
        self._frames: list[_Joint] = []
        self._every, self._seen = 1, 0

    def add(self, session: SessionFilter) -> None:
        """Adds the newest line of ``session`` if it is in contact."""
        found = session.newest
        if found is None or not found.explained or found.force.contact < MIN_CONTACT:
            return
        self._seen += 1
        if self._seen % self._every:
            return
        mean, covariance = session.joint()
        self._frames.append(_Joint.of(mean, covariance, session.prior_std))
        if len(self._frames) > _MAX_FRAMES:  # thin out: keep every second frame, now and from now on
            self._frames = self._frames[::2]
            self._every *= 2

    def limits(self, view: str) -> ForceLimits:
        """Returns the contribution of each group to the force's standard deviation, as medians over the frames.

        Args:
            view: name of the view, for the remedies.
        """
        frames = self._frames
        if len(frames) < MIN_FRAMES:
            return ForceLimits(self._seen, math.nan)
        std_n = _median_std(frames, ())
        contributions_n = {group: _gone(std_n, _median_std(frames, group.unknowns)) for group in GROUPS}
        measurable: list[Limit] = []
        known: tuple[int, ...] = ()
        for group in sorted(GROUPS, key=lambda group: -contributions_n[group]):
            known += group.unknowns
            remedy = group.remedy.replace("{view}", view)
            measurable.append(Limit(group.name, contributions_n[group], _median_std(frames, known), remedy))
        # left when all is known: across, the noise of the line limits the force; along, the shape itself does
        left_n = np.sqrt([frame.residual((*known, *LINE_ERROR.unknowns)) for frame in frames])
        across_n, along_n = np.median(left_n, axis=0).tolist()
        line_n = math.hypot(_gone(std_n, _median_std(frames, LINE_ERROR.unknowns)), across_n)
        others = (
            Limit(LINE_ERROR.name, line_n, math.nan, LINE_ERROR.remedy),
            Limit(SHAPE.name, along_n, math.nan, SHAPE.remedy),
        )
        return ForceLimits(self._seen, std_n, tuple(measurable), others)


def _median_std(frames: "Sequence[_Joint]", unknowns: Sequence[int]) -> float:
    return float(np.median([math.sqrt(each.variance_left(unknowns)) for each in frames]))


def _gone(std_n: float, left_n: float) -> float:
    return math.sqrt(max(0.0, std_n**2 - left_n**2))


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    """The Gaussian of one frame.

    Attributes:
        covariance: (COUNT, COUNT) of force and unknowns.
        direction: (COUNT,) of the force, zero elsewhere.
        information: (COUNT,) inverse variance of a measurement of each unknown; 0: none is better than the prior.
    """

    covariance: FloatArray
    direction: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, mean: FloatArray, covariance: FloatArray, prior_std: FloatArray) -> "_Joint":
        """Makes the Gaussian of a frame from mean (COUNT,) and covariance (COUNT, COUNT) of force and unknowns.

        ``prior_std`` (COUNT,): their standard deviations before the session. See the module for the information.
        """
        direction, information = np.zeros(COUNT), np.zeros(COUNT)
        direction[:FORCE] = mean[:FORCE] / max(math.hypot(*mean[:FORCE]), 1e-9)
        for group in (*GROUPS, LINE_ERROR):
            for unknown in group.unknowns:
                prior = float(prior_std[unknown])
                left = _LEFT_SHARE * prior if group.left is None else group.left
                information[unknown] = max(0.0, left**-2 - prior**-2) if prior > 0.0 else 0.0
        return cls(covariance, direction, information)

    def variance_left(self, unknowns: Sequence[int]) -> float:
        """Returns the variance of the magnitude, N^2, when ``unknowns`` are measured."""
        return max(0.0, float(self.direction[:FORCE] @ self._force_covariance(unknowns) @ self.direction[:FORCE]))

    def residual(self, unknowns: Sequence[int]) -> tuple[float, float]:
        """Returns the variance of the magnitude that is left when all ``unknowns`` are known, N^2, in two parts.

        The first is across the direction of the force that the shape shows least, the second along it.
        """
        variances, axes = np.linalg.eigh(self._force_covariance(unknowns))  # the smaller variance first
        parts = np.maximum(variances, 0.0) * (self.direction[:FORCE] @ axes) ** 2
        return float(parts[0]), float(parts[1])

    def _force_covariance(self, unknowns: Sequence[int]) -> FloatArray:
        """Returns the (2, 2) covariance of the force when ``unknowns`` are measured (Kalman update, see the module)."""
        measured = [unknown for unknown in unknowns if self.information[unknown] > 0.0]
        force = self.covariance[:FORCE, :FORCE]
        if measured:
            innovation = self.covariance[np.ix_(measured, measured)] + np.diag(1.0 / self.information[measured])
            cross = self.covariance[:FORCE, measured]
            force = force - cross @ np.linalg.solve(innovation, cross.T)
        return 0.5 * (force + force.T)
