"""The result of an estimator: a force with its uncertainty, or "not valid" with the reason."""

import math
from dataclasses import dataclass

import numpy as np

from ._arrays import BoolArray, FloatArray, frozen
from ._shape import DetectedShape
from ._status import Status

MAX_AGE_S = 1.0
"""No force is used whose image is older, for any settings and any rate of the camera: live and in the loop."""

_NO_INTERVAL = (math.nan, math.nan)


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBeside:
    """The catheter in a view beyond the first.

    Attributes:
        view: name of the view.
        shape: the catheter as detected in the newest image of the view.
        axes_px: (3, 2) directions of x, y and z of the base frame in that image; the length of each is 1 where the axis
            is parallel to the image, and 0 where it points to the viewer. None where the directions are not known.
    """

    view: str
    shape: DetectedShape
    axes_px: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.axes_px is not None:
            object.__setattr__(self, "axes_px", frozen("axes_px", self.axes_px, (3, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class ForceEstimate:
    """Force of the tissue on the tip, base frame, newtons, at one instant.

    An invalid estimate has NaN everywhere, never an old number.

    Attributes:
        stamp_ns: mid-exposure of the image.
        force_n: (3,) force, N; NaN in unknown components.
        known: (3,) whether each component is known: a planar method leaves z unknown, and a method that yields only the
            magnitude leaves all three unknown.
        covariance_n2: (3, 3) covariance, N^2; NaN where unknown.
        interval_n: (3, 2) 90 % interval of each component, N.
        magnitude_n: magnitude, N.
        magnitude_interval_n: (2,) 90 % interval of the magnitude, N.
        status: `Status.VALID`, or the reason why there is no force.
        detail: the reason in one line.
        contact: probability that the tip touches anything; NaN from methods that do not estimate it.
        shape: the catheter as detected in the image; None from methods that detect none.
        abstained_interval_n: 90 % interval of the magnitude of an estimate that is invalid because this interval is too
            wide; NaN in every other case. It is for safety functions only, which must act on its upper end; it is never
            displayed as a force.
        shapes_beside: the catheter in each further view that the method reads.
        tip_axis: (3,) unit vector along the tip, from base to tip, base frame; None from methods that know the
            direction of the tip in the image only.
    """

    stamp_ns: int
    force_n: FloatArray
    known: BoolArray
    covariance_n2: FloatArray
    interval_n: FloatArray
    magnitude_n: float
    magnitude_interval_n: FloatArray
    status: Status = Status.VALID
    detail: str = ""
    contact: float = math.nan
    shape: DetectedShape | None = None
    abstained_interval_n: tuple[float, float] = _NO_INTERVAL
    shapes_beside: tuple[ShapeBeside, ...] = ()
    tip_axis: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "force_n", frozen("force_n", self.force_n, (3,)))
        object.__setattr__(self, "known", frozen("known", self.known, (3,), np.bool_))
        object.__setattr__(self, "covariance_n2", frozen("covariance_n2", self.covariance_n2, (3, 3)))
        object.__setattr__(self, "interval_n", frozen("interval_n", self.interval_n, (3, 2)))
        object.__setattr__(
            self, "magnitude_interval_n", frozen("magnitude_interval_n", self.magnitude_interval_n, (2,))
        )
        if self.tip_axis is not None:
            object.__setattr__(self, "tip_axis", frozen("tip_axis", self.tip_axis, (3,)))
        if self.valid == math.isnan(self.magnitude_n):
            raise ValueError(f"a {self.status} estimate must not have the magnitude {self.magnitude_n}")
        if self.valid and not math.isnan(self.abstained_interval_n[1]):
            raise ValueError(f"a valid estimate must not have abstained_interval_n = {self.abstained_interval_n}")

    @property
    def valid(self) -> bool:
        """Whether the numbers may be used."""
        return self.status is Status.VALID

    @property
    def upper_n(self) -> float:
        """Upper end of the 90 % interval of the magnitude, also of an estimate that abstains; NaN where it is unknown.

        A valid estimate without an interval has its magnitude here.

        >>> ForceEstimate.invalid(0, Status.UNOBSERVABLE, "0.21 to 0.70 N", abstained_interval_n=(0.21, 0.7)).upper_n
        0.7
        """
        if not self.valid:
            return self.abstained_interval_n[1]
        high = float(self.magnitude_interval_n[1])
        return self.magnitude_n if math.isnan(high) else high

    def checked(self) -> "ForceEstimate":
        """Returns this estimate, or an invalid one with the reason where its numbers cannot be a force.

        This check is made for every estimator before its result is used.
        """
        wrong = self._impossible() if self.valid else ""
        if not wrong:
            return self
        return self.invalid(self.stamp_ns, Status.UNOBSERVABLE, f"the method returned {wrong}", self.shape)

    def _impossible(self) -> str:
        """Returns the impossible number and the expected one as text; empty if all are possible."""
        if not 0.0 <= self.magnitude_n < math.inf:
            return f"a magnitude of {self.magnitude_n:g} N; expected a finite number of at least 0"
        components = self.force_n[self.known]
        if not np.isfinite(components).all():
            return f"the force {components.tolist()} N in known components; expected finite numbers"
        for name, (low, high) in zip(
            ("x", "y", "z", "the magnitude"), (*self.interval_n, self.magnitude_interval_n), strict=True
        ):
            if low > high:
                return f"an interval of {name} from {low:g} to {high:g} N; expected the lower end first"
        if np.any(np.diagonal(self.covariance_n2) < 0.0):
            return "a negative variance of the force"
        if not (math.isnan(self.contact) or 0.0 <= self.contact <= 1.0):
            return f"a probability of contact of {self.contact:g}; expected 0 to 1"
        return ""

    @classmethod
    def invalid(
        cls,
        stamp_ns: int,
        status: Status,
        detail: str,
        shape: DetectedShape | None = None,
        abstained_interval_n: tuple[float, float] = _NO_INTERVAL,
    ) -> "ForceEstimate":
        """Returns an estimate that states why there is no force.

        Args:
            stamp_ns: mid-exposure of the image.
            status: any but `Status.VALID`.
            detail: the reason, in one line.
            shape: the detected catheter.
            abstained_interval_n: 90 % interval of the magnitude, where the reason is that it is too wide.

        >>> ForceEstimate.invalid(0, Status.NO_CATHETER, "nothing dark at the left border").valid
        False
        """
        nan = math.nan
        return cls(
            stamp_ns=stamp_ns,
            force_n=np.full(3, nan),
            known=np.zeros(3, dtype=np.bool_),
            covariance_n2=np.full((3, 3), nan),
            interval_n=np.full((3, 2), nan),
            magnitude_n=nan,
            magnitude_interval_n=np.full(2, nan),
            status=status,
            detail=detail,
            shape=shape,
            abstained_interval_n=abstained_interval_n,
        )
