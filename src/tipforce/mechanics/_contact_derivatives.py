"""How the centreline of a catheter in contact moves with all that is uncertain of it, instant by instant."""

from dataclasses import dataclass

import numpy as np

from ..types import BoolArray, FloatArray, frozen
from ._arc import arc_m
from ._spatial_parts import Load, elastic_of, line_of, make_work
from ._spatial_rod import SpatialRod
from ._spatial_slopes import Places, Rows, Spare, slope_rows

__all__ = ["ContactDerivatives", "contact_derivatives"]

_COLUMNS = {
    "force": slice(0, 3),
    "moment": slice(3, 6),
    "precurvature": slice(6, 8),
    "length": slice(8, 9),
    "creep": slice(9, 10),
}


@dataclass(frozen=True, slots=True, eq=False)
class ContactDerivatives:
    """First derivatives of a centreline at m instants; base frame.

    ``centreline_m`` (m, points, 3). ``slopes`` (m, points, 3, columns); ``columns``: name -> its columns.
    "force": m/N, 3 of them, where it acts. "moment": m/(N m) on the electrode, 3. "precurvature": m per 1/m about y and
    z of the material frame, the same all along. "length": m/m of the flexible shaft, curvature and stiffness kept.
    "creep": m per unit of the relative change of what the shaft crept by. "stiffness": m per unit of relative change
    of EI and GJ, one for each pattern. ``stable`` (m,): where an equilibrium was found that is a minimum; elsewhere
    the row means nothing.
    """

    centreline_m: FloatArray
    slopes: FloatArray
    columns: dict[str, slice]
    stable: BoolArray

    def __getitem__(self, name: str) -> FloatArray:
        """(m, points, 3, c): the columns called ``name``."""
        return self.slopes[..., self.columns[name]]


def contact_derivatives(
    rod: SpatialRod,
    lines_m: FloatArray,
    force_n: FloatArray,
    touch_m: FloatArray,
    points: int | FloatArray,
    *,
    tip_radius_m: float = 0.0,
    precurvature_change_per_m: FloatArray | None = None,
    stiffness_patterns: FloatArray | None = None,
    time_s: FloatArray | None = None,
    creep: float = 0.0,
    creep_time_s: float = 1.0,
) -> ContactDerivatives:
    """Equilibria of ``rod`` under known forces, and the derivatives of their centrelines by implicit functions.

    ``lines_m`` (m, p, 3): centrelines, uniform in arc length, roughly as they are: they tell which of several
    equilibria is meant. ``force_n`` (m, 3) acts at ``touch_m`` (m, 3) of the electrode's dome, whose radius is
    ``tip_radius_m``. ``points``: how many along the centreline, evenly, or their arc lengths.
    ``precurvature_change_per_m`` (m, 3): as in `press_spatial`. ``stiffness_patterns`` (patterns, segments + 1):
    relative change of the stiffness in each joint; None: one, the same all along. With ``creep`` (as in
    `SpatialPress`) the strains at ``time_s`` (m,) are taken to last until the next instant.

    >>> rod = SpatialRod(0.05, 4.3e-4, segments=100)
    >>> line = np.linspace(0, 1, 11)[None, :, None] * [0.05, 0.0, 0.0]
    >>> found = contact_derivatives(rod, line, np.zeros((1, 3)), line[:, -1], np.array([0.05]))
    >>> (found["force"][0, 0, 1, 1] / (0.05**3 / (3 * 4.3e-4))).round(3)  # the linear beam's L^3 / 3EI
    np.float64(1.0)
    """
    lines = frozen("lines_m", lines_m, (None, None, 3))
    m, k = len(lines), rod.segments + 1
    force, touch = np.array(frozen("force_n", force_n, (m, 3))), frozen("touch_m", touch_m, (m, 3))
    change = np.zeros((m, 3)) if precurvature_change_per_m is None else precurvature_change_per_m
    patterns = np.ones((1, k)) if stiffness_patterns is None else stiffness_patterns
    patterns = np.array(frozen("stiffness_patterns", patterns, (None, k)))
    if creep > 0 and time_s is None:
        raise ValueError("creep needs the instants time_s")
    times = np.arange(m, dtype=np.float64) if time_s is None else frozen("time_s", time_s, (m,))
    axis = lines[:, -1] - lines[:, -2]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    # Where nothing touches, the place means nothing: the arm is none.
    pressed = np.any(force != 0.0, axis=1)
    arm = np.where(pressed[:, None], touch - (lines[:, -1] - tip_radius_m * axis), 0.0)
    rows = Rows(
        q=orientations_along(rod, lines),
        change=np.array(frozen("precurvature_change_per_m", change, (m, 3))),
        force=force,
        moment=np.cross(arm, force),
        arm=arm,
        relaxing=np.expm1(np.diff(times, append=times[-1:]) / creep_time_s),
    )
    elastic = elastic_of(rod, rod.rigid_length_m - tip_radius_m)._replace(maxwell=creep)
    arc = arc_m(rod.element_lengths_m, points)
    begins = np.cumsum(rod.element_lengths_m) - rod.element_lengths_m
    order = np.argsort(arc, kind="stable")
    element = np.clip(np.searchsorted(begins, arc[order], side="right") - 1, 0, k - 1)
    places = Places(element, arc[order] - begins[element], rod.element_lengths_m, rod.flexible_length_m)
    columns = {**_COLUMNS, "stiffness": slice(10, 10 + len(patterns))}
    count = columns["stiffness"].stop
    spare = Spare(
        rod=elastic._replace(**{name: np.zeros_like(getattr(elastic, name)) for name in _ARRAYS}),
        unit=Load(np.zeros(3), np.zeros(3), line_of(rod, None)),
        here=np.zeros(3 * k),
        sides=np.zeros((count, 3 * k)),
        moves=np.zeros((count, 3)),
    )
    line, slopes, good = np.empty((m, arc.size, 3)), np.empty((m, arc.size, 3, count)), np.empty(m)
    slope_rows(
        rows, elastic, Load(np.zeros(3), np.zeros(3), line_of(rod, None)), np.array(rod.precurvature_per_m), patterns,
        places, spare, make_work(k, 0), line, slopes, good,
    )  # fmt: skip
    back = np.argsort(order, kind="stable")
    return ContactDerivatives(line[:, back], slopes[:, back], columns, good > 0)


_ARRAYS = ("span", "bend", "twist", "rest", "reach", "memory")


def orientations_along(rod: SpatialRod, lines_m: FloatArray) -> FloatArray:
    """(m, segments + 1, 4): orientations of the elements along centrelines (m, p, 3), uniform in arc length.

    Each frame is turned on from the one before by the shortest way, so there is no twist but that of the curve.
    """
    lengths = rod.element_lengths_m
    place = np.concatenate([[0.0], np.cumsum(lengths)]) / rod.length_m * (lines_m.shape[1] - 1)
    low = np.minimum(place.astype(np.int64), lines_m.shape[1] - 2)
    share = (place - low)[:, None]
    nodes = lines_m[:, low] * (1 - share) + lines_m[:, low + 1] * share
    tangents = np.diff(nodes, axis=1)
    if rod.rigid_length_m == 0.0:
        tangents[:, -1] = tangents[:, -2]  # no length has no direction: the shaft's end has
    tangents /= np.linalg.norm(tangents, axis=2, keepdims=True)
    q = np.empty((len(lines_m), rod.segments + 1, 4))
    now, before = np.tile([1.0, 0.0, 0.0, 0.0], (len(lines_m), 1)), np.tile([1.0, 0.0, 0.0], (len(lines_m), 1))
    for i in range(rod.segments + 1):
        after = tangents[:, i]
        turn = np.column_stack([1.0 + np.sum(before * after, axis=1), np.cross(before, after)])
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        w, v = turn[:, :1], turn[:, 1:]
        scalar = w * now[:, :1] - np.sum(v * now[:, 1:], axis=1, keepdims=True)
        now = np.hstack([scalar, w * now[:, 1:] + now[:, :1] * v + np.cross(v, now[:, 1:])])
        before = after
        q[:, i] = now
    return q
