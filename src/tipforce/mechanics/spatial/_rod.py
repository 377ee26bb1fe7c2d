"""A catheter in space: a flexible shaft clamped at the base, with a rigid electrode at its tip."""

import math
from dataclasses import dataclass, field

import numpy as np

from ...types import FloatArray, frozen
from .._arc import arc_m, element_lengths_m, joint_spans_m, way_m
from ._compile import compiled

_TORSION = 2 / 3
"""GJ / EI of a round section of an incompressible material: 1 / (1 + Poisson's ratio), which is 1/2."""


def frames_of(quaternions: FloatArray) -> FloatArray:
    """Returns rotations (..., 3, 3), columns: tangent, y and z axis, of unit quaternions (..., 4), w, x, y, z.

    >>> frames_of(np.array([1.0, 0.0, 0.0, 0.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@compiled
def integrate_strain(strain: FloatArray, span: FloatArray, q: FloatArray) -> None:
    """Computes the orientations of the elements from the strain of the joints.

    Args:
        strain: (k, 3) twist and curvatures about y and z, 1/m.
        span: (k,) length of each joint in m.
        q: (k, 4) quaternions (w, x, y, z) that are written.
    """
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        a, b, c = strain[i, 0] * span[i], strain[i, 1] * span[i], strain[i, 2] * span[i]
        half = 0.5 * math.sqrt(a * a + b * b + c * c)
        cosine, share = math.cos(half), 0.5 if half == 0.0 else 0.5 * math.sin(half) / half
        a, b, c = share * a, share * b, share * c
        w, x, y, z = (
            w * cosine - x * a - y * b - z * c,
            w * a + x * cosine + y * c - z * b,
            w * b + y * cosine + z * a - x * c,
            w * c + z * cosine + x * b - y * a,
        )
        q[i, 0], q[i, 1], q[i, 2], q[i, 3] = w, x, y, z


@dataclass(frozen=True, slots=True, eq=False)
class SpatialRod:
    """Inextensible, unshearable rod (Kirchhoff) in the base frame: clamped at the origin, tangent x there.

    Its strain u = (twist, curvature about y, curvature about z), per metre, is that of the material frame, whose first
    axis is the tangent and which is the base frame at the clamp; a positive curvature about z bends toward +y.

    With ``stiffening_curvature_per_m`` k_s the bending energy per metre, b the curvature's two components, is
    EI (|b - b_0|^2 / 2 + (|b|^4 / 4 - (b.b_0) |b|^2 / 3 + |b_0|^4 / 12) / k_s^2). Its moment is
    EI (1 + (b/k_s)^2) (b - b_0) where b is parallel to b_0 or b_0 = 0, as in the plane. That law itself has no energy
    in two dimensions; this is its symmetric part, the same in all directions around the shaft. GJ does not stiffen.

    Attributes:
        flexible_length_m: length of the shaft.
        bending_stiffness_nm2: EI.
        rigid_length_m: length of the electrode beyond the shaft's end.
        torsional_stiffness_nm2: GJ; None: 2/3 EI.
        precurvature_per_m: strain u_0 without load, (3,), or (segments + 1, 3) at the joints from clamp to electrode.
        stiffening_curvature_per_m: k_s; infinite: no stiffening.
        stiffness_profile: (segments + 1,) factors at the joints, on both EI and GJ; None: ones.
        segments: number of straight segments of the shaft; positions are second order in their length.

    Raises:
        ValueError: a value has no physical meaning.
    """

    flexible_length_m: float
    bending_stiffness_nm2: float
    rigid_length_m: float = 0.0
    torsional_stiffness_nm2: float | None = None
    precurvature_per_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    stiffening_curvature_per_m: float = math.inf
    stiffness_profile: FloatArray | None = None
    segments: int = 50

    def __post_init__(self) -> None:
        """Checks the values; pre-curvature and profile become read-only arrays with one row for each joint."""
        gj = self.gj_nm2
        if not (self.flexible_length_m > 0 and self.bending_stiffness_nm2 > 0 and gj > 0 and self.rigid_length_m >= 0):
            raise ValueError(
                "a rod needs positive lengths and stiffness, got flexible_length_m "
                f"{self.flexible_length_m}, bending_stiffness_nm2 {self.bending_stiffness_nm2}, "
                f"torsional_stiffness_nm2 {gj}, rigid_length_m {self.rigid_length_m}"
            )
        if self.segments < 4:
            raise ValueError(f"a rod needs at least 4 segments, got {self.segments}")
        joints = self.segments + 1
        rest = np.asarray(self.precurvature_per_m, dtype=np.float64)
        rest = frozen("precurvature_per_m", np.tile(rest, (joints, 1)) if rest.ndim == 1 else rest, (joints, 3))
        object.__setattr__(self, "precurvature_per_m", rest)
        profile = np.ones(joints) if self.stiffness_profile is None else self.stiffness_profile
        profile = frozen("stiffness_profile", profile, (joints,))
        object.__setattr__(self, "stiffness_profile", profile)
        if not (np.isfinite(rest).all() and np.isfinite(profile).all() and (profile > 0).all()):
            raise ValueError("a rod needs finite precurvature_per_m and a positive stiffness_profile")
        self.check_stiffening(rest)

    def check_stiffening(self, precurvature_per_m: FloatArray) -> None:
        """Checks that no pre-curvature is too large for the stiffening law.

        Beyond sqrt(3) k_s the energy is not convex in the curvature: no unique shape even without load.

        Args:
            precurvature_per_m: (..., 3) pre-curvatures.

        Raises:
            ValueError: one is too large.
        """
        largest = float(np.max(np.hypot(precurvature_per_m[..., 1], precurvature_per_m[..., 2]), initial=0.0))
        if largest >= math.sqrt(3) * self.stiffening_curvature_per_m:
            raise ValueError(
                f"precurvature_per_m must stay below {math.sqrt(3):.3f} stiffening_curvature_per_m "
                f"({self.stiffening_curvature_per_m} 1/m), got {largest:.4g} 1/m"
            )

    @property
    def gj_nm2(self) -> float:
        """Torsional stiffness at a profile of 1."""
        given = self.torsional_stiffness_nm2
        return _TORSION * self.bending_stiffness_nm2 if given is None else given

    @property
    def length_m(self) -> float:
        """Length of shaft and electrode together."""
        return self.flexible_length_m + self.rigid_length_m

    @property
    def element_lengths_m(self) -> FloatArray:
        """Lengths (segments + 1,) of the segments, then of the electrode."""
        return element_lengths_m(self.flexible_length_m, self.rigid_length_m, self.segments)

    @property
    def joint_spans_m(self) -> FloatArray:
        """Length (segments + 1,) of shaft whose strain is in each joint; half a segment at both ends."""
        return joint_spans_m(self.flexible_length_m, self.segments)

    @property
    def unloaded_quaternions(self) -> FloatArray:
        """Orientation (segments + 1, 4), w, x, y, z, of each segment and of the electrode, without load."""
        out = np.empty((self.segments + 1, 4))
        integrate_strain(self.precurvature_per_m, self.joint_spans_m, out)
        return out

    def nodes_m(self, quaternions: FloatArray, advance_m: float | FloatArray = 0.0) -> FloatArray:
        """Returns the nodes: clamp, segment ends, tip of the electrode.

        Args:
            quaternions: (..., segments + 1, 4) orientations of the elements.
            advance_m: (...) advance of the clamp along x.

        Returns:
            (..., segments + 2, 3) positions in the base frame.

        >>> rod = SpatialRod(0.04, 4.3e-4, 0.008, segments=4)
        >>> rod.nodes_m(rod.unloaded_quaternions)[-1]
        array([0.048, 0.   , 0.   ])
        """
        w, x, y, z = np.moveaxis(quaternions, -1, 0)
        tangents = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1)
        nodes = np.zeros((*tangents.shape[:-2], self.segments + 2, 3))
        np.cumsum(self.element_lengths_m[:, None] * tangents, axis=-2, out=nodes[..., 1:, :])
        nodes[..., 0] += np.asarray(advance_m)[..., None]
        return nodes

    def centreline_m(self, quaternions: FloatArray, points: int | FloatArray) -> FloatArray:
        """Returns the centreline (points, 3), base to tip.

        Args:
            quaternions: (segments + 1, 4) orientations of the elements.
            points: number of points, evenly spaced, or their arc lengths in m.

        Raises:
            ValueError: an arc length is outside the rod.
        """
        lengths = self.element_lengths_m
        return way_m(lengths, arc_m(lengths, points)) @ frames_of(quaternions)[:, :, 0]
