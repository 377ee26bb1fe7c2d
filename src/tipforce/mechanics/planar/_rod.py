"""A planar catheter: a flexible shaft clamped at the base, with a rigid electrode at its tip."""

import math
from dataclasses import dataclass

import numpy as np

from ...types import FloatArray, frozen


@dataclass(frozen=True, slots=True, eq=False)
class PlanarRod:
    """Inextensible planar rod in the base frame: clamped at the origin, tangent x there, bending about z.

    The shaft carries the moment M = EI (1 + (k / k_s)^2) (k - k_0) at curvature k. The joints are at the clamp, between
    segments, and at the electrode's root.

    Attributes:
        flexible_length_m: length of the shaft.
        bending_stiffness_nm2: EI where the profile is 1.
        rigid_length_m: length of the electrode, which continues from the shaft's end.
        precurvature_per_m: k_0, positive: bends toward +y; one value, or (segments + 1,) at the joints.
        stiffening_curvature_per_m: k_s; infinite: the moment grows with k alone.
        stiffness_profile: (segments + 1,) positive factors on EI at the joints; None: 1 everywhere.
        segments: number of straight segments of the shaft; positions are second order in their length.

    Raises:
        ValueError: a value has no physical meaning, or a row has the wrong length.

    >>> PlanarRod(0.04, 4.3e-4, segments=4, stiffness_profile=np.array([1.1, 1.1, 1, 1, 1])).stiffnesses_nm2
    array([0.000473, 0.000473, 0.00043 , 0.00043 , 0.00043 ])
    """

    flexible_length_m: float
    bending_stiffness_nm2: float
    rigid_length_m: float = 0.0
    precurvature_per_m: float | FloatArray = 0.0
    stiffening_curvature_per_m: float = math.inf
    stiffness_profile: FloatArray | None = None
    segments: int = 50

    def __post_init__(self) -> None:
        """Checks the values; arrays become read-only copies."""
        if not (self.flexible_length_m > 0 and self.bending_stiffness_nm2 > 0 and self.rigid_length_m >= 0):
            raise ValueError(f"a rod needs positive lengths and stiffness, got {self}")
        if self.segments < 4:
            raise ValueError(f"a rod needs at least 4 segments, got {self.segments}")
        joints = (self.segments + 1,)
        if np.ndim(self.precurvature_per_m) > 0:
            object.__setattr__(
                self, "precurvature_per_m", frozen("precurvature_per_m", self.precurvature_per_m, joints)
            )
        if self.stiffness_profile is not None:
            object.__setattr__(self, "stiffness_profile", frozen("stiffness_profile", self.stiffness_profile, joints))
            if not (self.stiffness_profile > 0).all():
                raise ValueError(f"stiffness_profile must be positive, got {self.stiffness_profile.min()}")
        # Above this limit the moment falls with growing curvature in some range: no unique shape even without load.
        if not np.abs(self.precurvature_per_m).max() < math.sqrt(3) * self.stiffening_curvature_per_m:
            raise ValueError(
                f"precurvature_per_m must stay below {math.sqrt(3):.3f} stiffening_curvature_per_m, got {self}"
            )

    @property
    def length_m(self) -> float:
        """Length of shaft and electrode together."""
        return self.flexible_length_m + self.rigid_length_m

    @property
    def precurvatures_per_m(self) -> FloatArray:
        """Curvature (segments + 1,) of the unloaded shaft at its joints."""
        return np.full(self.segments + 1, self.precurvature_per_m, dtype=np.float64)

    @property
    def stiffnesses_nm2(self) -> FloatArray:
        """EI (segments + 1,) at the joints, for small curvature."""
        profile = 1.0 if self.stiffness_profile is None else self.stiffness_profile
        return np.full(self.segments + 1, self.bending_stiffness_nm2 * profile)
