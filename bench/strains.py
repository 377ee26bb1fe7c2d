"""Energy and loads of a spatial shape from its orientations alone, in plain NumPy, without the solver."""

import numpy as np
from scipy.spatial.transform import Rotation

from tipforce.mechanics import SpatialRod


def rotation_vectors(quaternions: np.ndarray) -> np.ndarray:
    """(..., k, 4) -> (..., k, 3): turn in each joint, in the frame of the element before it."""
    before = np.concatenate(
        [np.broadcast_to([1.0, 0, 0, 0], quaternions[..., :1, :].shape), quaternions[..., :-1, :]], -2
    )
    flat = [q.reshape(-1, 4) for q in (before, quaternions)]
    first, second = (Rotation.from_quat(q, scalar_first=True) for q in flat)
    return (first.inv() * second).as_rotvec().reshape(*quaternions.shape[:-1], 3)


def density(rod: SpatialRod, strain: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(..., k): elastic energy per metre in each joint at ``strain`` (..., k, 3); ``rest``: without load."""
    u, u0 = strain - rest, rest
    now, then = np.sum(strain[..., 1:] ** 2, -1), np.sum(u0[..., 1:] ** 2, -1)
    both, soft = np.sum(strain[..., 1:] * u0[..., 1:], -1), rod.stiffening_curvature_per_m**-2
    bending = 0.5 * np.sum(u[..., 1:] ** 2, -1) + soft * (now**2 / 4 - both * now / 3 + then**2 / 12)
    whole = rod.bending_stiffness_nm2 * bending + 0.5 * rod.gj_nm2 * u[..., 0] ** 2
    return whole * np.asarray(rod.stiffness_profile)


def linear_density(rod: SpatialRod, strain: np.ndarray) -> np.ndarray:
    """(..., k): energy per metre of springs as stiff as EI and GJ, without stiffening."""
    squares = rod.bending_stiffness_nm2 * np.sum(strain[..., 1:] ** 2, -1) + rod.gj_nm2 * strain[..., 0] ** 2
    return 0.5 * squares * np.asarray(rod.stiffness_profile)


def moment(rod: SpatialRod, strain: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(..., k, 3): gradient of `density` with the strain."""
    b, b0, soft = strain[..., 1:], rest[..., 1:], rod.stiffening_curvature_per_m**-2
    both, now = np.sum(b * b0, -1, keepdims=True), np.sum(b * b, -1, keepdims=True)
    bending = b - b0 + soft * (now * b - (now * b0 + 2 * both * b) / 3)
    twist = rod.gj_nm2 * (strain[..., :1] - rest[..., :1])
    whole = np.concatenate([twist, rod.bending_stiffness_nm2 * bending], axis=-1)
    return whole * np.asarray(rod.stiffness_profile)[:, None]


def carried(turns: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(..., 3): from the moment that works on a rotation vector's rate to the one that works on the spin.

    Both in the frame of the element before the joint (Bullo and Murray 1995).
    """
    angle = np.linalg.norm(turns, axis=-1, keepdims=True)
    safe = np.where(angle < 1e-4, 1.0, angle)
    factor = np.where(angle < 1e-4, 1 / 12, (1 - safe / 2 / np.tan(safe / 2)) / safe**2)
    return moments + np.cross(turns, moments) / 2 + factor * np.cross(turns, np.cross(turns, moments))
