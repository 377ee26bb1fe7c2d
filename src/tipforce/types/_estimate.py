"""What an estimator answers: a force with its uncertainty, or a plain "not valid" with the reason."""

import math
from dataclasses import dataclass

import numpy as np

from ._arrays import BoolArray, FloatArray, frozen
from ._shape import DetectedShape
from ._status import Status

__all__ = ["ForceEstimate"]


@dataclass(frozen=True, slots=True, eq=False)
class ForceEstimate:
    """Force of the tissue on the tip, base frame, newtons, at one instant.

    ``force_n`` (3,), ``known`` (3,) bool: a planar method leaves z unknown, a method that yields the magnitude alone
    leaves all three unknown; unknown components are NaN. ``covariance_n2`` (3, 3), NaN where unknown.
    ``interval_n`` (3, 2) and ``magnitude_interval_n`` (2,): 90 % intervals. An invalid estimate carries NaN
    everywhere, never an old number. ``contact``: probability that the tip touches anything, NaN from methods that do
    not estimate it. ``shape``: the catheter as it was detected in the image, None from methods that detect none.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "force_n", frozen("force_n", self.force_n, (3,)))
        object.__setattr__(self, "known", frozen("known", self.known, (3,), np.bool_))
        object.__setattr__(self, "covariance_n2", frozen("covariance_n2", self.covariance_n2, (3, 3)))
        object.__setattr__(self, "interval_n", frozen("interval_n", self.interval_n, (3, 2)))
        object.__setattr__(
            self, "magnitude_interval_n", frozen("magnitude_interval_n", self.magnitude_interval_n, (2,))
        )
        if self.valid == math.isnan(self.magnitude_n):
            raise ValueError(f"a {self.status} estimate must not have the magnitude {self.magnitude_n}")

    @property
    def valid(self) -> bool:
        """True where the numbers may be used."""
        return self.status is Status.VALID

    @classmethod
    def invalid(cls, stamp_ns: int, status: Status, detail: str, shape: DetectedShape | None = None) -> "ForceEstimate":
        """An estimate that says why there is none.

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
        )
