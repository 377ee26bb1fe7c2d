"""A chain of straight links under a load at its tip."""

import math

import numpy as np

from ...types import FloatArray
from .._rod import Rod
from ._chain import Chain, settle
from ._face import Bent

__all__ = ["bend_links", "first_share"]


def bend_links(rod: Rod, chain: Chain, clamped_m: float, force_n: FloatArray, moment_nm: float) -> Bent:
    """Straight links behind a first one of ``clamped_m`` that stays along x."""
    fx, fy = float(force_n[0]), float(force_n[1])
    angles = np.empty(chain.span_m.size)
    converged = settle(chain, fx, fy, float(moment_nm), first_share(rod, fx, fy, moment_nm), angles)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ways *= (chain.link_m + chain.give_m_per_n * (ways @ np.array([fx, fy])))[:, None]
    nodes = np.zeros((angles.size + 2, 2))
    arc = np.zeros(angles.size + 2)
    nodes[1:, 0] = arc[1:] = clamped_m
    nodes[2:] += np.cumsum(ways, axis=0)
    arc[2:] += np.cumsum(chain.link_m)
    return Bent(arc, nodes, bool(converged))


def first_share(rod: Rod, fx: float, fy: float, moment_nm: float) -> float:
    """Share of the load that bends the rod by a radian or less."""
    size = (math.hypot(fx, fy) * rod.length_m**2 + abs(moment_nm) * rod.length_m) / rod.bending_stiffness_nm2
    return 1.0 / max(1.0, math.ceil(size))
