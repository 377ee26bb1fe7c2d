"""From the base line to the tip: candidate entries of a shaft, and tracing one of them station by station.

A station is a short profile across the predicted axis. Where both flanks are detected, a filter of fixed gain corrects
position, direction and curvature. Where they are not (ring, highlight, gap, crossing cable), the arc found so far is
extrapolated and the next pair that fits is searched. A profile is read around the two expected flanks only, so that
the cost does not grow with the diameter.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ._pixels import Raster, fast, grey_at, grey_between, measure_pair, prefetch_pair

U, V, ARC, WIDE, WEIGHT, KIND = range(6)
"""Columns of the array of stations: position in px, arc length, width, weight in the fit, kind."""
SHAFT, OTHER, TAPER, PALE = 1, 2, 3, 4
"""Kinds of stations: the shaft; parallel flanks with other grey levels, such as metal; narrower, as at a tip; paler."""

END_TIP = 0
"""No more flanks: the shaft ends here."""
END_BORDER = 1
"""The shaft leaves the region."""
END_LOST = 2
"""The shaft continues behind a gap that is longer than allowed."""
END_SHORT = 3
"""Not even a few stations hang together: this is no shaft."""
_PREFETCH_PX = 20.0
"""How far ahead of a station its pixels are prefetched. A cache line holds some 20 pixels in colour."""


class BaseLine(NamedTuple):
    """A line of ``n`` pixels from (u, v) in steps of (du, dv); (eu, ev) points into the image."""

    u: int
    v: int
    du: int
    dv: int
    n: int
    eu: int
    ev: int


class Candidate(NamedTuple):
    """One entry to be traced, and what is known of the catheter; lengths in px, unknown ones are 0."""

    sign: float
    """+1 for a light shaft, -1 for a dark one."""
    u: float
    v: float
    heading: float
    """Direction across the base line into the image, radians, v down."""
    width: float
    contrast: float
    level: float
    """Grey level inside, times ``sign``."""
    diameter: float
    max_gap: float
    depth: float
    """How far inside the base line the entry lies; the curve is continued back to the line."""
    base_length: float
    """Length of shaft that the base tangent is fitted to."""
    length: float
    """Of the catheter from the base line to the tip."""
    tolerance: float
    """Of ``length``."""


class TracedShaft(NamedTuple):
    """Result of `trace_shaft`; lengths in px."""

    n: int
    """Number of stations."""
    end: int
    """Why the trace ended: one of the ``END_`` constants."""
    diameter: float
    contrast: float
    last: float
    """Arc length of the last station."""
    gap: float
    """`END_LOST`: length of the gap. `END_BORDER`: length without flanks before the border."""
    blind: float
    """Arc length without flanks."""


@fast
def find_entries(
    frame: tuple[Any, ...], start: tuple[int, ...], sign: float, width_low: float, width_high: float,
    threshold: float, least: float, line: np.ndarray, slope: np.ndarray, edges: np.ndarray, entries: np.ndarray,
) -> int:  # fmt: skip
    """Finds candidates for the shaft on one line: pairs of opposite edges.

    ``frame``, ``start``: the fields of a `Raster` and a `BaseLine`, as plain tuples: numba needs some 2 us to accept a
    named one. Three pixels are averaged towards the inside of the image. ``sign``: +1 for a light shaft, -1 for a dark
    one. ``width_low``, ``width_high``: widths along the line in px. ``threshold``: grey level between catheter and
    ground; negative if unknown. ``least``: minimum contrast. ``line``, ``slope``, ``edges``: buffers, the first two at
    least as long as the line. ``entries`` (k, 4) receives centre and width along the line in px, contrast and
    grey level inside, the highest contrast first; their count is returned.
    """
    image, base = Raster(*frame), BaseLine(*start)
    n = base.n
    for i in range(n):
        total = 0.0
        for k in range(3):
            total += grey_at(image, base.u + i * base.du + k * base.eu, base.v + i * base.dv + k * base.ev)
        line[i] = sign * total / 3.0
    for i in range(2, n - 2):
        slope[i] = 0.5 * (line[i + 1] + line[i + 2] - line[i - 1] - line[i - 2])
    slope[0] = slope[1] = slope[n - 1] = slope[n - 2] = 0.0
    n_edges = 0
    for i in range(2, n - 2):
        a = abs(slope[i])
        if a >= 0.5 * least and a >= abs(slope[i - 1]) and a > abs(slope[i + 1]):
            if slope[i] * slope[i - 1] < 0.0 and a == abs(slope[i - 1]):
                continue
            edges[n_edges] = i
            n_edges += 1
            if n_edges == edges.shape[0]:
                break
    count = 0
    for p in range(n_edges):
        i = edges[p]
        if slope[i] <= 0.0:
            continue
        for q in range(p + 1, min(p + 7, n_edges)):
            j = edges[q]
            width = float(j - i)
            if width > width_high:
                break
            if slope[j] >= 0.0 or width < width_low:
                continue
            inside = 0.0
            for k in range(i + 1, j):
                inside += line[k]
            inside /= j - i - 1
            outside = max(line[max(0, i - 3)], line[min(n - 1, j + 3)])
            contrast = min(inside - outside, min(slope[i], -slope[j]) * 1.3)
            if contrast < least or (threshold >= 0.0 and inside < sign * threshold):
                continue
            at = count
            while at > 0 and entries[at - 1, 2] < contrast:
                at -= 1
            if at >= entries.shape[0]:
                continue
            if count < entries.shape[0]:
                count += 1
            for k in range(count - 1, at, -1):
                for m in range(4):
                    entries[k, m] = entries[k - 1, m]
            entries[at, 0] = 0.5 * (i + j)
            entries[at, 1] = width
            entries[at, 2] = contrast
            entries[at, 3] = sign * inside
    return count


@fast
def trace_shaft(image: Raster, candidate: Candidate, profile: np.ndarray, stations: np.ndarray) -> TracedShaft:
    """Traces the shaft of ``candidate``. ``profile``: buffer. ``stations`` (k, 6) receives the stations."""
    sign, max_gap = candidate.sign, candidate.max_gap
    heading, level = candidate.heading, candidate.level
    u, v = candidate.u, candidate.v
    angle, bend = heading, 0.0
    line_u, line_v = -math.sin(heading), math.cos(heading)
    half = 0.5 * candidate.width
    nominal = 0.5 * candidate.diameter if candidate.diameter > 0.0 else 0.0
    typical = candidate.contrast
    step = min(max((candidate.width if nominal == 0.0 else 2.0 * nominal) / 3.0, 1.25), 6.0)
    small = max(0.375 * step, 1.0)
    careful = 0.0
    s = 0.0
    n = 0
    kept = 0
    hits = 0
    streak = 0
    gap = 0.0
    lost = 0.0
    blind = 0.0
    occupied = 0
    empty = 0
    gap_from = 0.0
    taper_from = -1.0
    taper_at = 0
    end = END_TIP
    wide_sum = 0.0
    wide_n = 0.0
    along_border = 0
    while n < stations.shape[0]:
        starting = hits < 3
        if n == 0 and gap == 0.0:
            h = 0.5
        elif starting:
            h = min(step, 2.0)
        elif gap > 0.0:
            h = small if streak > 0 or gap <= max_gap else step
        else:
            h = small if s < careful else step
        middle = angle + 0.5 * bend * h
        pu = u + h * math.cos(middle)
        pv = v + h * math.sin(middle)
        turned = angle + bend * h
        if pu < image.left or pv < image.top or pu > image.right - 1.0 or pv > image.bottom - 1.0:
            end = END_BORDER
            lost = gap
            break
        s += h
        nu, nv = -math.sin(turned), math.cos(turned)
        slant = 1.0
        margin = half + 2.0
        leaves = pu - abs(nu) * margin < image.left or pu + abs(nu) * margin > image.right - 1.0
        leaves = leaves or pv - abs(nv) * margin < image.top or pv + abs(nv) * margin > image.bottom - 1.0
        if (leaves or starting) and s < 3.0 * half + 3.0:
            # beside the base's border a profile across the axis would leave the image: measure along the border instead
            slant = nu * line_u + nv * line_v
            if slant < 0.5:
                slant = 0.5
            nu, nv = line_u, line_v
        reach = min(max(0.28 * half, 1.5), 5.0)
        if starting:
            reach = max(reach, min(0.5 * half, 3.5))
        if gap > 0.0:
            reach = min(1.3 * reach + 0.12 * gap, max(0.7 * half, 2.0))
        ahead_u, ahead_v = pu + _PREFETCH_PX * math.cos(turned), pv + _PREFETCH_PX * math.sin(turned)
        prefetch_pair(image, ahead_u, ahead_v, nu, nv, half, reach)
        left, left_drop, right, right_drop = measure_pair(image, sign, pu, pv, nu, nv, half / slant, reach, profile)
        wide = (left + right) * slant
        off = 0.5 * (right - left) * slant
        deviation = abs(wide - 2.0 * half) / (2.0 * half)
        least = max(8.0, 0.25 * typical)
        kind = 0
        if left_drop > least and right_drop > least:
            kind = SHAFT
        elif left_drop < -1.2 * least and right_drop < -1.2 * least and deviation < 0.12:
            kind = OTHER
        elif min(abs(left_drop), abs(right_drop)) > max(10.0, 0.1 * typical) and deviation < 0.1:
            # other grey levels than the shaft's, but parallel flanks in their place: metal
            kind = OTHER
        if (
            kind > 0
            and gap > 0.0
            and hits > 3
            and (
                deviation > (0.28 if gap <= max_gap else 0.14)
                or (deviation > 0.1 and min(abs(left_drop), abs(right_drop)) < 0.35 * typical)
            )
        ):
            kind = 0
        elif kind > 0 and hits > 6 and deviation > 0.14 and min(abs(left_drop), abs(right_drop)) < 0.5 * typical:
            # pale and of another width: the blurred edge of a ring, not a taper of the shaft
            kind = 0
        if kind == SHAFT and hits > 8 and min(left_drop, right_drop) < 0.6 * typical:
            inside = sign * grey_between(image, min(pu, image.right - 1.001), min(pv, image.bottom - 1.001))
            if inside < level - 0.3 * typical:
                # parallel, but paler than the shaft: metal at best, or the shadow of the tip
                kind = OTHER
        if kind > 0 and nominal > 0.0:
            # it may widen slowly, as when it bends towards the camera, but not at once
            if wide > 2.64 * half or wide > 3.4 * nominal:
                kind = 0
            elif wide < 1.5 * nominal:
                kind = TAPER
        elif kind > 0 and hits > 8 and wide_n > 0.0:
            ratio = wide / (wide_sum / wide_n)
            if ratio > 1.32:
                kind = 0
            elif ratio < 0.75:
                kind = TAPER
        if kind == TAPER and hits > 8 and wide_n > 3.0:
            narrower = 0.5 * wide_sum / wide_n - 0.5 * wide
            if abs(off) > 0.6 * narrower:
                # one flank alone moves inwards: something crosses the shaft; a tip closes from both sides
                kind = 0
        if kind == 0:
            if gap == 0.0 and h > small and not starting:
                # go back and approach in small steps, to find where exactly the flanks end
                careful = s - 0.5 * small
                s -= h
                continue
            u, v, angle = pu, pv, turned
            if gap > max_gap:
                bend *= 1.0 - min(0.5, 0.25 * h / half)
            if gap == 0.0:
                if taper_from < 0.0 and wide_n > 3.0:
                    half = 0.5 * wide_sum / wide_n
                gap_from = s - h
                kept = n
                occupied = 0
                empty = 0
            gap += h
            streak = 0
            if (
                sign * grey_between(image, min(u, image.right - 1.001), min(v, image.bottom - 1.001))
                > level - 0.5 * typical
            ):
                occupied += 1
            else:
                empty += 1
            if starting and gap > max_gap + 2.0:
                end = END_SHORT
                break
            limit = 2.0 * max_gap + 3.0 * half
            if gap > limit:
                break
            continue
        # a pair of flanks: correct position, direction and curvature
        count = hits + 1.0
        if hits < 8:
            place_gain = max(0.6, 2.0 * (2.0 * count - 1.0) / (count * (count + 1.0)))
            turn_gain = max(0.2, min(0.6, 6.0 / (count * (count + 1.0))))
            bend_gain = 0.0 if hits < 4 else 0.04
        else:
            place_gain, turn_gain, bend_gain = 0.75, 0.4, 0.1
        if hits == 0:
            place_gain, turn_gain = 1.0, 0.0
        if hits > 6:
            # another width or a jump sideways is doubtful: the edge of a ring, the corner of a cable
            penalty = (deviation / 0.06) ** 2
            trust = 1.0 / (1.0 + penalty)
            place_gain *= max(trust, 0.15)
            turn_gain *= trust
            bend_gain *= trust
        lateral = off
        cu = pu + off / slant * nu
        cv = pv + off / slant * nv
        weight = 1.0 / (0.05 + (0.5 * (wide - 2.0 * half)) ** 2)
        if kind != SHAFT:
            weight *= 0.4
        stations[n, U] = cu
        stations[n, V] = cv
        stations[n, ARC] = s
        stations[n, WIDE] = wide
        stations[n, WEIGHT] = weight * 0.05
        stations[n, KIND] = kind if kind != SHAFT or hits < 8 or min(left_drop, right_drop) > 0.5 * typical else PALE
        if n == along_border and nu == line_u and nv == line_v:
            stations[n, WIDE] = wide / slant
            along_border += 1
        n += 1
        hits += 1
        u = pu + place_gain * off / slant * nu
        v = pv + place_gain * off / slant * nv
        run = h if starting else step
        angle = turned + turn_gain * lateral / run
        bend += bend_gain * lateral / (run * run)
        limit = 0.6 / half
        bend = min(max(bend, -limit), limit)
        if hits <= 3 and hits > 1:
            # at the first stations the direction is that of the centres
            first = n - hits
            angle = math.atan2(cv - stations[first, V], cu - stations[first, U]) if hits == 3 else angle
            if hits == 3:
                half *= max(0.5, line_v * math.cos(angle) - line_u * math.sin(angle))
        if kind != TAPER:
            if taper_from >= 0.0:
                taper_from = -1.0
            half += (0.15 if hits > 6 else 0.35) * (0.5 * wide - half)
            if kind == SHAFT and deviation < 0.1:
                typical += 0.1 * (min(left_drop, right_drop) - typical)
                wide_sum += wide
                wide_n += 1.0
                at_u = min(max(u, image.left), image.right - 1.001)
                at_v = min(max(v, image.top), image.bottom - 1.001)
                inside = sign * grey_between(image, at_u, at_v)
                level = inside if wide_n == 1.0 else level + 0.2 * (inside - level)
        else:
            half += 0.5 * (0.5 * wide - half)
            if taper_from < 0.0:
                taper_from = s
                taper_at = n
            full = nominal if nominal > 0.0 else 0.5 * wide_sum / max(wide_n, 1.0)
            if half < 0.25 * full or s - taper_from > 3.0 * full:
                if s - taper_from > 3.0 * full:
                    n = taper_at
                    s = stations[n - 1, ARC]
                break
        if gap > 0.0:
            streak += 1
            needed = 2 if gap <= half else 3
            if streak >= needed:
                length = stations[kept, ARC] - gap_from
                allowed = max_gap + (4.0 * half if occupied > empty else 0.0)
                if hits - streak > 3 and length > allowed + small:
                    lost = length
                    end = END_LOST
                    n = kept
                    break
                blind += length
                gap = 0.0
                streak = 0
    if gap > 0.0:
        n = kept
    if n < 4:
        end = END_SHORT
    # arc length along the measured centres: the first, slanted steps were longer than intended
    for i in range(1, n):
        stations[i, ARC] = stations[i - 1, ARC] + math.hypot(
            stations[i, U] - stations[i - 1, U], stations[i, V] - stations[i - 1, V]
        )
    diameter = wide_sum / wide_n if wide_n > 0.0 else 2.0 * half
    # the first stations got their weights before width and direction were known
    if n > 0 and along_border > 0:
        far = min(n - 1, max(along_border, 4))
        run_u, run_v = stations[far, U] - stations[0, U], stations[far, V] - stations[0, V]
        upright = abs(line_v * run_u - line_u * run_v) / max(math.hypot(run_u, run_v), 1e-6)
        for i in range(min(n, along_border)):
            stations[i, WIDE] *= upright
    for i in range(min(n, max(6, along_border))):
        stations[i, WEIGHT] = 0.05 / (0.05 + (0.5 * (stations[i, WIDE] - diameter)) ** 2) * (0.6 if i < 3 else 1.0)
    last = stations[n - 1, ARC] if n > 0 else 0.0
    return TracedShaft(n, end, diameter, typical, last, lost, blind)


@fast
def add_station(stations: np.ndarray, n: int, u: float, v: float, s: float, half: float, weight: float) -> int:
    """Adds a station beyond the traced ones, behind the first ``n``: at (u, v), arc length ``s``; returns n + 1."""
    stations[n, U] = u
    stations[n, V] = v
    stations[n, ARC] = s
    stations[n, WIDE] = 2.0 * half
    stations[n, WEIGHT] = weight
    stations[n, KIND] = OTHER
    return n + 1
