"""Energy of the spatial rod with its contact, and the forces of the contact."""

import math

from ..types import FloatArray
from ._spatial_compile import compiled
from ._spatial_joint import joint_energy, log_scale
from ._spatial_parts import Elastic, Load, Touch

__all__ = ["contact_at", "energy_at", "normal_force", "tangential_force", "tip_at"]


@compiled
def normal_force(touch: Touch, depth: float) -> tuple[float, float, float]:
    """Normal force of the dome, its slope with the depth, and its energy from ``touch.rest`` on."""
    if not (touch.active and depth > touch.rest):
        return 0.0, 0.0, 0.0
    over, since, base = depth - touch.dent, depth - touch.rest, touch.rest - touch.dent
    force, slope = touch.rate * over, touch.rate
    energy = 0.5 * touch.rate * (over * over - base * base)
    if touch.hertz > 0.0:
        root = touch.hertz * math.sqrt(depth)
        force += touch.stiffness * root * depth
        slope += 1.5 * touch.stiffness * root
        energy += 0.4 * touch.stiffness * (root * depth * depth - touch.hertz * touch.rest**2.5)
    else:
        force += touch.stiffness * depth
        slope += touch.stiffness
        energy += 0.5 * touch.stiffness * since * (depth + touch.rest)
    return force, slope, energy


@compiled
def tangential_force(touch: Touch, normal: float, first: float, second: float) -> tuple[float, float, bool]:
    """What the wall does to the dome along t1 and t2, and whether it slips there."""
    if touch.kt <= 0.0:
        return touch.drag[0], touch.drag[1], False
    t1, t2 = -touch.kt * first, -touch.kt * second
    pull, limit = math.hypot(t1, t2), touch.friction * normal
    if touch.friction < 0.0 or pull <= limit:
        return t1, t2, False
    return t1 * limit / pull, t2 * limit / pull, True


@compiled
def tip_at(q: FloatArray, rod: Elastic, tangent: FloatArray) -> tuple[float, float, float]:
    """The lever's end less the clamp; leaves the elements' directions in ``tangent`` (k, 3)."""
    px = py = pz = 0.0
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        tx, ty, tz = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        tangent[i, 0], tangent[i, 1], tangent[i, 2] = tx, ty, tz
        reach = rod.reach[i]
        px += reach * tx
        py += reach * ty
        pz += reach * tz
    return px, py, pz


@compiled
def contact_at(q: FloatArray, px: float, py: float, pz: float, touch: Touch) -> tuple[float, float, float]:
    """Depth of the dome, and the way of its touching point from ``touch.zero`` along t1 and t2, rolling counted."""
    axes, last = touch.axes, q.shape[0] - 1
    w, x, y, z = q[last, 0], q[last, 1], q[last, 2], q[last, 3]
    a, b, c = touch.arm[0], touch.arm[1], touch.arm[2]
    # v + 2 q x (q x v + w v), the quaternion's rotation of the arm
    u, v, s = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    mx, my, mz = px + a + 2.0 * (y * s - z * v), py + b + 2.0 * (z * u - x * s), pz + c + 2.0 * (x * v - y * u)
    depth = axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz + touch.radius - touch.place
    first = axes[1, 0] * mx + axes[1, 1] * my + axes[1, 2] * mz - touch.zero[0]
    second = axes[2, 0] * mx + axes[2, 1] * my + axes[2, 2] * mz - touch.zero[1]
    return depth, first, second


@compiled
def energy_at(q: FloatArray, rod: Elastic, load: Load, touch: Touch, tangent: FloatArray) -> float:
    """Elastic energy less the work of the dead forces, at the orientations ``q`` (k, 4). A moment has no energy."""
    total = 0.0
    w0, x0, y0, z0 = 1.0, 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        c = w0 * w + x0 * x + y0 * y + z0 * z
        a = w0 * x - x0 * w - y0 * z + z0 * y
        b = w0 * y - y0 * w - z0 * x + x0 * z
        d = w0 * z - z0 * w - x0 * y + y0 * x
        f = log_scale(a * a + b * b + d * d, abs(c)) / rod.span[i]
        if c < 0.0:
            f = -f
        rest = (rod.rest[i, 0], rod.rest[i, 1], rod.rest[i, 2])
        memory = (rod.memory[i, 0], rod.memory[i, 1], rod.memory[i, 2])
        strain = (f * a, f * b, f * d)
        total += rod.span[i] * joint_energy(rod.bend[i], rod.twist[i], rod.soft, strain, rest, memory, rod.maxwell)
        w0, x0, y0, z0 = w, x, y, z
    px, py, pz = tip_at(q, rod, tangent)
    total -= load.force[0] * px + load.force[1] * py + load.force[2] * pz
    for i in range(q.shape[0]):
        line = load.line[i]
        total -= line[0] * tangent[i, 0] + line[1] * tangent[i, 1] + line[2] * tangent[i, 2]
    if touch.active:
        depth, first, second = contact_at(q, px, py, pz, touch)
        total += normal_force(touch, depth)[2]
        total += 0.5 * touch.kt * (first * first + second * second) - touch.drag[0] * first - touch.drag[1] * second
        if touch.side > 0.0:
            height = touch.side_radius - touch.place
            for i in range(q.shape[0] - 1):
                for axis in range(3):
                    height += rod.reach[i] * tangent[i, axis] * touch.axes[0, axis]
                if height > 0.0:
                    total += 0.5 * touch.side * height * height
    return total
