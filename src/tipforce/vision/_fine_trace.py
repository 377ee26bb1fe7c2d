"""Following a shaft from its base to its tip, station by station.

A station is a short profile across the predicted axis. Where both flanks are seen, a fixed lag corrects place,
direction and curvature; where they are not (ring, highlight, gap, crossing cable), the arc found so far is continued
and the next pair that fits is looked for. The profile is read around the two expected flanks only, so that the cost
does not grow with the diameter.
"""

import math

import numpy as np

from ._fine_pixels import fast, fetch_pair, grey_between, measure_pair

__all__ = ["END_BORDER", "END_LOST", "END_SHORT", "END_TIP", "trace_shaft"]

END_TIP = 0
"""No more flanks: the shaft ends here."""
END_BORDER = 1
"""It runs out of the picture."""
END_LOST = 2
"""It goes on behind a gap that is longer than allowed."""
END_SHORT = 3
"""Not even a few stations hang together: this is no shaft."""
_FETCH = 20.0
"""How far ahead of a station its pixels are asked for, px."""


@fast
def trace_shaft(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    sign: float,
    entry_u: float,
    entry_v: float,
    heading: float,
    width: float,
    contrast: float,
    fixed_width: float,
    max_gap: float,
    scratch: np.ndarray,
    stations: np.ndarray,
    report: np.ndarray,
) -> tuple[int, int]:
    """Trace from (entry_u, entry_v) in the direction ``heading`` (radians, v down), which is across the base line.

    ``fixed_width`` > 0: the known diameter. ``stations`` (k, 6) receives u, v, arc length, width, weight and kind
    (1 shaft, 2 other grey levels, 3 taper, 4 pale shaft). ``report``: width of the shaft, contrast, arc length of the
    last station, the inside's grey level times ``sign`` (set it before), length of the gap (END_LOST) or of shaft
    unseen before the border (END_BORDER), arc length without flanks. Returns (stations, way it ended).
    """
    u, v = entry_u, entry_v
    angle, bend = heading, 0.0
    line_u, line_v = -math.sin(heading), math.cos(heading)
    half = 0.5 * width
    nominal = 0.5 * fixed_width if fixed_width > 0.0 else 0.0
    typical = contrast
    step = min(max((width if nominal == 0.0 else 2.0 * nominal) / 3.0, 1.25), 6.0)
    small = max(0.375 * step, 1.0)
    careful = 0.0
    s = 0.0
    n = 0
    kept = 0
    hits = 0
    streak = 0
    gap = 0.0
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
        if pu < box[0] or pv < box[1] or pu > box[2] - 1.0 or pv > box[3] - 1.0:
            end = END_BORDER
            report[4] = gap
            break
        s += h
        nu, nv = -math.sin(turned), math.cos(turned)
        slant = 1.0
        margin = half + 2.0
        if (pu - abs(nu) * margin < box[0] or pu + abs(nu) * margin > box[2] - 1.0 or pv - abs(nv) * margin < box[1]
                or pv + abs(nv) * margin > box[3] - 1.0 or starting) and s < 3.0 * half + 3.0:  # fmt: skip
            # beside the base's border an upright profile would leave the picture: look along the border instead
            slant = nu * line_u + nv * line_v
            if slant < 0.5:
                slant = 0.5
            nu, nv = line_u, line_v
        reach = min(max(0.28 * half, 1.5), 5.0)
        if starting:
            reach = max(reach, min(0.5 * half, 3.5))
        if gap > 0.0:
            reach = min(1.3 * reach + 0.12 * gap, max(0.7 * half, 2.0))
        # A line of the caches holds some 20 pixels in colour: what is read next comes while this is looked at.
        fetch_pair(
            pixels, row, channels, pu + _FETCH * math.cos(turned), pv + _FETCH * math.sin(turned), nu, nv, half, reach
        )
        left, left_drop, right, right_drop = measure_pair(
            pixels, row, channels, box, sign, pu, pv, nu, nv, half / slant, reach, scratch
        )
        wide = (left + right) * slant
        off = 0.5 * (right - left) * slant
        strange = abs(wide - 2.0 * half) / (2.0 * half)
        least = max(8.0, 0.25 * typical)
        kind = 0
        if left_drop > least and right_drop > least:
            kind = 1
        elif left_drop < -1.2 * least and right_drop < -1.2 * least and strange < 0.12:
            kind = 2
        elif min(abs(left_drop), abs(right_drop)) > max(10.0, 0.1 * typical) and strange < 0.1:
            # other grey levels than the shaft's, but parallel flanks in their place: metal
            kind = 2
        if (
            kind > 0
            and gap > 0.0
            and hits > 3
            and (
                strange > (0.28 if gap <= max_gap else 0.14)
                or (strange > 0.1 and min(abs(left_drop), abs(right_drop)) < 0.35 * typical)
            )
        ):
            kind = 0
        elif kind > 0 and hits > 6 and strange > 0.14 and min(abs(left_drop), abs(right_drop)) < 0.5 * typical:
            # pale and of another width: the blurred begin of a ring, not the shaft growing thin
            kind = 0
        if kind == 1 and hits > 8 and min(left_drop, right_drop) < 0.6 * typical:
            inside = sign * grey_between(pixels, row, channels, min(pu, box[2] - 1.001), min(pv, box[3] - 1.001))
            if inside < report[3] - 0.3 * typical:
                # parallel, but paler than the shaft: metal at best, or the shadow that the shaft's end throws
                kind = 2
        if kind > 0 and nominal > 0.0:
            # it may widen slowly, as when it comes towards the camera, but not at once
            if wide > 2.64 * half or wide > 3.4 * nominal:
                kind = 0
            elif wide < 1.5 * nominal:
                kind = 3
        elif kind > 0 and hits > 8 and wide_n > 0.0:
            ratio = wide / (wide_sum / wide_n)
            if ratio > 1.32:
                kind = 0
            elif ratio < 0.75:
                kind = 3
        if kind == 3 and hits > 8 and wide_n > 3.0:
            narrower = 0.5 * wide_sum / wide_n - 0.5 * wide
            if abs(off) > 0.6 * narrower:
                # one flank alone moves inwards: something crosses the shaft, a tip closes from both sides
                kind = 0
        if kind == 0:
            if gap == 0.0 and h > small and not starting:
                # go back and come closer in small steps, to see where exactly the flanks end
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
                sign * grey_between(pixels, row, channels, min(u, box[2] - 1.001), min(v, box[3] - 1.001))
                > report[3] - 0.5 * typical
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
        # a pair of flanks: correct place, direction and curvature
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
            # a pair of another width, or a jump aside, is doubtful: a ring's edge, a cable's corner
            doubt = (strange / 0.06) ** 2
            trust = 1.0 / (1.0 + doubt)
            place_gain *= max(trust, 0.15)
            turn_gain *= trust
            bend_gain *= trust
        lateral = off
        if slant < 1.0 or starting:
            # along the border: the offset's part across the axis
            lateral = off
        cu = pu + off / slant * nu
        cv = pv + off / slant * nv
        weight = 1.0 / (0.05 + (0.5 * (wide - 2.0 * half)) ** 2)
        if kind != 1:
            weight *= 0.4
        stations[n, 0] = cu
        stations[n, 1] = cv
        stations[n, 2] = s
        stations[n, 3] = wide
        stations[n, 4] = weight * 0.05
        stations[n, 5] = kind if kind != 1 or hits < 8 or min(left_drop, right_drop) > 0.5 * typical else 4.0
        if n == along_border and nu == line_u and nv == line_v:
            stations[n, 3] = wide / slant
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
            # the first stations: the direction is that of the centres themselves
            first = n - hits
            angle = math.atan2(cv - stations[first, 1], cu - stations[first, 0]) if hits == 3 else angle
            if hits == 3:
                half *= max(0.5, line_v * math.cos(angle) - line_u * math.sin(angle))
        if kind != 3:
            if taper_from >= 0.0:
                taper_from = -1.0
            half += (0.15 if hits > 6 else 0.35) * (0.5 * wide - half)
            if kind == 1 and strange < 0.1:
                typical += 0.1 * (min(left_drop, right_drop) - typical)
                wide_sum += wide
                wide_n += 1.0
                inside = sign * grey_between(pixels, row, channels, min(u, box[2] - 1.001), min(v, box[3] - 1.001))
                report[3] = inside if wide_n == 1.0 else report[3] + 0.2 * (inside - report[3])
        else:
            half += 0.5 * (0.5 * wide - half)
            if taper_from < 0.0:
                taper_from = s
                taper_at = n
            full = nominal if nominal > 0.0 else 0.5 * wide_sum / max(wide_n, 1.0)
            if half < 0.25 * full or s - taper_from > 3.0 * full:
                if s - taper_from > 3.0 * full:
                    n = taper_at
                    s = stations[n - 1, 2]
                break
        if gap > 0.0:
            streak += 1
            needed = 2 if gap <= half else 3
            if streak >= needed:
                length = stations[kept, 2] - gap_from
                allowed = max_gap + (4.0 * half if occupied > empty else 0.0)
                if hits - streak > 3 and length > allowed + small:
                    report[4] = length
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
    # arc length along the measured centres: the first, slanted steps were longer than they were meant to be
    for i in range(1, n):
        stations[i, 2] = stations[i - 1, 2] + math.hypot(
            stations[i, 0] - stations[i - 1, 0], stations[i, 1] - stations[i - 1, 1]
        )
    report[0] = wide_sum / wide_n if wide_n > 0.0 else 2.0 * half
    # the first stations were weighed before width and direction were known
    if n > 0 and along_border > 0:
        far = min(n - 1, max(along_border, 4))
        run_u, run_v = stations[far, 0] - stations[0, 0], stations[far, 1] - stations[0, 1]
        upright = abs(line_v * run_u - line_u * run_v) / max(math.hypot(run_u, run_v), 1e-6)
        for i in range(min(n, along_border)):
            stations[i, 3] *= upright
    for i in range(min(n, max(6, along_border))):
        stations[i, 4] = 0.05 / (0.05 + (0.5 * (stations[i, 3] - report[0])) ** 2) * (0.6 if i < 3 else 1.0)
    report[1] = typical
    report[2] = stations[n - 1, 2] if n > 0 else 0.0
    report[5] = blind
    return n, end
