"""A planar catheter: a flexible shaft clamped at the base, with a rigid electrode at its tip."""

import math
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray

__all__ = ["Rod"]


@dataclass(frozen=True, slots=True)
class Rod:
    """Inextensible planar rod in the base frame: clamped at the origin, tangent x there, bending about z.

    The shaft of ``flexible_length_m`` carries the moment M = EI (1 + (k / k_s)^2) (k - k_0) at curvature k, with
    EI = ``bending_stiffness_nm2``, k_0 = ``precurvature_per_m`` (positive: bends toward +y) and
    k_s = ``stiffening_curvature_per_m`` (infinite: constant stiffness). An electrode of ``rigid_length_m`` goes on from
    its end. ``segments``: straight segments of the shaft; positions are second order in their length.

    Raises ValueError where a value has no physical meaning.
    """

    flexible_length_m: float
    bending_stiffness_nm2: float
    rigid_length_m: float = 0.0
    precurvature_per_m: float = 0.0
    stiffening_curvature_per_m: float = math.inf
    segments: int = 50

    def __post_init__(self) -> None:
        if not (self.flexible_length_m > 0 and self.bending_stiffness_nm2 > 0 and self.rigid_length_m >= 0):
            raise ValueError(f"a rod needs positive lengths and stiffness, got {self}")
        if self.segments < 4:
            raise ValueError(f"a rod needs at least 4 segments, got {self.segments}")
        # Beyond this the moment would fall with growing curvature somewhere: no unique shape even without load.
        if abs(self.precurvature_per_m) >= math.sqrt(3) * self.stiffening_curvature_per_m:
            raise ValueError(
                f"precurvature_per_m must stay below {math.sqrt(3):.3f} stiffening_curvature_per_m, got {self}"
            )

    @property
    def length_m(self) -> float:
        """Shaft and electrode together."""
        return self.flexible_length_m + self.rigid_length_m

    @property
    def unloaded_angles_rad(self) -> FloatArray:
        """(segments + 1,): tangent angle in the middle of each segment, then of the electrode, without load."""
        step = self.flexible_length_m / self.segments
        middle = (np.arange(self.segments) + 0.5) * step
        return self.precurvature_per_m * np.append(middle, self.flexible_length_m)

    def nodes_m(self, angles_rad: FloatArray) -> FloatArray:
        """(..., segments + 1) angles -> (..., segments + 2, 2): base, segment ends, tip of the electrode.

        >>> Rod(0.04, 4.3e-4, 0.008, segments=4).nodes_m(np.zeros(5))[-1]
        array([0.048, 0.   ])
        """
        lengths = np.full(self.segments + 1, self.flexible_length_m / self.segments)
        lengths[-1] = self.rigid_length_m
        steps = lengths[:, None] * np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=-1)
        nodes = np.zeros((*steps.shape[:-2], self.segments + 2, 2))
        np.cumsum(steps, axis=-2, out=nodes[..., 1:, :])
        return nodes

    def centreline_m(self, angles_rad: FloatArray, points: int) -> FloatArray:
        """(segments + 1,) angles -> (points, 2), base to tip, uniform in arc length."""
        step = self.flexible_length_m / self.segments
        arc = np.append(np.arange(self.segments + 1) * step, self.length_m)
        nodes = self.nodes_m(angles_rad)
        wanted = np.linspace(0.0, self.length_m, points)
        return np.stack([np.interp(wanted, arc, nodes[:, 0]), np.interp(wanted, arc, nodes[:, 1])], axis=1)
