"""Traces one shaft station by station, from its entry on the base line to its end.

The idea: the axis of a catheter is smooth. So the next piece of the axis can be predicted from position, direction and
curvature so far, and only two short profiles around the expected flanks have to be read. The loop of `trace_shaft`:

1. *predict*: go one step along the circle through the last position (`_choose_step`, `_predict`);
2. *measure*: read both flanks across the predicted axis (`_measure`);
3. *classify*: shaft, other grey levels, taper, or no pair (`_classify`);
4. *correct*: an alpha-beta-gamma filter moves position, direction and curvature toward the measured centre, and width
   and grey levels follow slowly (`_correct`, `_update_appearance`);
5. *end*: without a pair the axis is extrapolated over a gap, until a pair fits again (`_extend_gap`, `_close_gap`) or
   the gap is too long; a taper that has closed ends the trace, too (the loop).

The filter has fixed gains after the first eight stations. Before, the gains are those of a recursive least-squares fit
of a line (Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 6.5).
The cost of a frame does not grow with the diameter, because the profiles are read around the flanks only.
"""

import math
from typing import NamedTuple

import numpy as np

from ._pixels import Raster, fast, grey_between, measure_pair
from ._stations import (
    ARC,
    END_BORDER,
    END_LOST,
    END_SHORT,
    END_TIP,
    KIND,
    NONE,
    OTHER,
    PALE,
    SHAFT,
    TAPER,
    WEIGHT,
    WIDTH,
    U,
    V,
)


class TraceLimits(NamedTuple):
    """Limits of the trace. "Share of the contrast" refers to the shaft's mean contrast so far."""

    first_stations: int = 3
    """Stations before the direction is known; their direction is the one across the base line."""
    max_first_step_px: float = 2.0
    max_step_px: float = 6.0
    min_step_px: float = 1.25
    fine_step_share: float = 0.375
    """Length of a fine step (around a gap) in steps."""
    min_contrast_grey: float = 8.0
    """Smallest drop of a flank in grey levels."""
    min_contrast_share: float = 0.25
    """Smallest drop of a flank, as a share of the contrast."""
    max_deviation_inverted: float = 0.12
    """Largest relative deviation of the width where both flanks are inverted, as on bright metal."""
    inverted_share: float = 1.2
    """Inverted flanks must be this much stronger than normal ones."""
    max_deviation_other: float = 0.1
    """Largest relative deviation of the width where the flanks have any other grey level."""
    min_other_grey: float = 10.0
    min_other_share: float = 0.1
    max_deviation_short_gap: float = 0.28
    """Largest relative deviation of the width behind a gap of at most the allowed length."""
    max_deviation_long_gap: float = 0.14
    """The same behind a longer gap, and for pale flanks anywhere."""
    weak_gap_share: float = 0.35
    """Behind a gap, flanks below this share of the contrast must have the width of the shaft."""
    pale_share: float = 0.5
    """Flanks below this share of the contrast are pale."""
    shadow_share: float = 0.6
    """Flanks below this share are checked for the grey level inside."""
    shadow_level_share: float = 0.3
    """A pair whose inside is darker than the shaft's by this share of the contrast is metal or a shadow."""
    max_widening: float = 1.32
    """Largest ratio of a width to the mean width (diameter unknown) or to twice the current half width (known)."""
    max_diameter_ratio: float = 1.7
    """Largest ratio of a width to the known diameter: the shaft widens where it bends toward the camera."""
    taper_ratio: float = 0.75
    """Below this ratio to the full width a pair counts as a taper."""
    one_sided_share: float = 0.6
    """A taper whose centre moves by more than this share of its narrowing is something that crosses the shaft."""
    closed_share: float = 0.25
    """A taper has closed at this share of the full half width."""
    max_taper_widths: float = 3.0
    """A taper that is longer than this many full widths is not a tip; the trace ends where it began."""
    max_turn: float = 0.6
    """Largest curvature times half width."""


LIMITS = TraceLimits()
WEIGHT_FLOOR_PX2 = 0.05
"""Variance of the half width that a perfect station has, in px^2; it makes the largest weight 1."""


class Candidate(NamedTuple):
    """One entry to be traced, and the known properties of the catheter; lengths in px, unknown ones are 0."""

    sign: float
    """+1 for a light shaft, -1 for a dark one."""
    u: float
    v: float
    heading: float
    """Direction across the base line into the image, in radians, v down."""
    width: float
    """Width along the base line."""
    contrast: float
    """Contrast in grey levels."""
    level: float
    """Grey level inside, times ``sign``."""
    diameter: float
    max_gap: float
    depth: float
    """Distance of the entry from the base line; the curve is continued back to the line."""
    base_length: float
    """Length of shaft that the base tangent is fitted to."""
    length: float
    """Length of the catheter from the base line to the tip."""
    tolerance: float
    """Tolerance of ``length``."""


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


class _Axis(NamedTuple):
    """The filter's estimate of the axis at one arc length."""

    u: float
    v: float
    angle: float
    """Direction in radians, v down."""
    curvature: float
    """In 1/px."""


class _Appearance(NamedTuple):
    """The filter's estimate of the shaft's size and grey levels."""

    half_width: float
    contrast: float
    level: float
    """Grey level inside, times the sign of the polarity."""
    width_sum: float
    """Sum of the widths of the clear stations, in px."""
    width_count: float
    """Number of clear stations."""


class _Gap(NamedTuple):
    """A stretch without flanks; ``length`` is 0 where there is none."""

    length: float
    start_arc: float
    kept: int
    """Number of stations before it."""
    streak: int
    """Pairs found behind it in succession; after two or three the gap is closed."""
    filled: int
    """Points of the extrapolated axis that have the shaft's grey level."""
    bare: int
    """Points of the extrapolated axis that have not."""


class _Pair(NamedTuple):
    """The two flanks measured across the predicted axis."""

    width: float
    offset: float
    """Distance of their centre from the predicted axis, in px, positive to the side of the normal."""
    deviation: float
    """Relative difference of their width from the expected one."""
    left_drop: float
    right_drop: float
    normal_u: float
    normal_v: float
    """Unit vector along which the profile was read."""
    slant: float
    """Cosine of the angle between that vector and the normal of the axis."""


class _Scale(NamedTuple):
    """Lengths in px that stay constant during a trace."""

    step: float
    fine_step: float
    known_half_width: float
    """0 if the diameter is unknown."""
    max_gap: float
    border_u: float
    border_v: float
    """Unit vector along the base line."""


_NO_GAP = _Gap(0.0, 0.0, 0, 0, 0, 0)


@fast
def _choose_step(n: int, arc: float, fine_until: float, gap: _Gap, scale: _Scale) -> float:
    """Returns the length of the next step in px: short at the entry and around gaps."""
    if n == 0 and gap.length == 0.0:
        return 0.5
    if n < LIMITS.first_stations:
        return min(scale.step, LIMITS.max_first_step_px)
    if gap.length > 0.0:
        return scale.fine_step if gap.streak > 0 or gap.length <= scale.max_gap else scale.step
    return scale.fine_step if arc < fine_until else scale.step


@fast
def _predict(axis: _Axis, step: float) -> _Axis:
    """Moves the axis forward by ``step`` px along its circle (chord with the mean direction)."""
    middle = axis.angle + 0.5 * axis.curvature * step
    return _Axis(
        axis.u + step * math.cos(middle),
        axis.v + step * math.sin(middle),
        axis.angle + axis.curvature * step,
        axis.curvature,
    )


@fast
def _inside(image: Raster, axis: _Axis) -> bool:
    return not (axis.u < image.left or axis.v < image.top or axis.u > image.right - 1.0 or axis.v > image.bottom - 1.0)


@fast
def _search_reach(half_width: float, starting: bool, gap: float) -> float:
    """Returns how far from its expected position a flank is searched, in px; farther at the entry and after a gap."""
    reach = min(max(0.28 * half_width, 1.5), 5.0)
    if starting:
        reach = max(reach, min(0.5 * half_width, 3.5))
    if gap > 0.0:
        reach = min(1.3 * reach + 0.12 * gap, max(0.7 * half_width, 2.0))
    return reach


@fast
def _measure(
    image: Raster, sign: float, axis: _Axis, half_width: float, arc: float, starting: bool, gap: float, scale: _Scale,
    profile: np.ndarray,
) -> _Pair:  # fmt: skip
    """Reads both flanks across the predicted axis.

    Near the base a profile across the axis may leave the image; it is then read along the border.
    """
    normal_u, normal_v = -math.sin(axis.angle), math.cos(axis.angle)
    slant = 1.0
    margin = half_width + 2.0
    leaves = axis.u - abs(normal_u) * margin < image.left or axis.u + abs(normal_u) * margin > image.right - 1.0
    leaves = leaves or axis.v - abs(normal_v) * margin < image.top
    leaves = leaves or axis.v + abs(normal_v) * margin > image.bottom - 1.0
    if (leaves or starting) and arc < 3.0 * half_width + 3.0:
        slant = normal_u * scale.border_u + normal_v * scale.border_v
        if slant < 0.5:
            slant = 0.5
        normal_u, normal_v = scale.border_u, scale.border_v
    reach = _search_reach(half_width, starting, gap)
    left, left_drop, right, right_drop = measure_pair(
        image, sign, axis.u, axis.v, normal_u, normal_v, half_width / slant, reach, profile
    )
    width = (left + right) * slant
    offset = 0.5 * (right - left) * slant
    deviation = abs(width - 2.0 * half_width) / (2.0 * half_width)
    return _Pair(width, offset, deviation, left_drop, right_drop, normal_u, normal_v, slant)


@fast
def _flank_kind(pair: _Pair, contrast: float) -> int:
    """Classifies a pair by the drops of its flanks alone."""
    least = max(LIMITS.min_contrast_grey, LIMITS.min_contrast_share * contrast)
    if pair.left_drop > least and pair.right_drop > least:
        return SHAFT
    inverted = -LIMITS.inverted_share * least
    if pair.left_drop < inverted and pair.right_drop < inverted and pair.deviation < LIMITS.max_deviation_inverted:
        return OTHER
    weaker = min(abs(pair.left_drop), abs(pair.right_drop))
    other_least = max(LIMITS.min_other_grey, LIMITS.min_other_share * contrast)
    return OTHER if weaker > other_least and pair.deviation < LIMITS.max_deviation_other else NONE


@fast
def _fits_shaft(pair: _Pair, n: int, gap: float, contrast: float, max_gap: float) -> bool:
    """Returns whether the pair has the width that a continuation of the shaft must have, behind a gap above all."""
    weaker = min(abs(pair.left_drop), abs(pair.right_drop))
    if gap > 0.0 and n > 3:
        widest = LIMITS.max_deviation_short_gap if gap <= max_gap else LIMITS.max_deviation_long_gap
        if pair.deviation > widest:
            return False
        if pair.deviation > LIMITS.max_deviation_other and weaker < LIMITS.weak_gap_share * contrast:
            return False
    # a pale pair of another width is the blurred edge of a ring, not a taper
    return not (n > 6 and pair.deviation > LIMITS.max_deviation_long_gap and weaker < LIMITS.pale_share * contrast)


@fast
def _classify(
    image: Raster, sign: float, pair: _Pair, predicted: _Axis, n: int, gap: float, shaft: _Appearance, scale: _Scale
) -> int:
    """Returns the kind of the pair: `SHAFT`, `OTHER`, `TAPER`, or `NONE` where it is not on the shaft."""
    kind = _flank_kind(pair, shaft.contrast)
    if kind == NONE or not _fits_shaft(pair, n, gap, shaft.contrast, scale.max_gap):
        return NONE
    if kind == SHAFT and n > 8 and min(pair.left_drop, pair.right_drop) < LIMITS.shadow_share * shaft.contrast:
        inside = sign * grey_between(
            image, min(predicted.u, image.right - 1.001), min(predicted.v, image.bottom - 1.001)
        )
        if inside < shaft.level - LIMITS.shadow_level_share * shaft.contrast:
            kind = OTHER
    if scale.known_half_width > 0.0:
        too_wide = 2.0 * LIMITS.max_widening * shaft.half_width
        if pair.width > too_wide or pair.width > 2.0 * LIMITS.max_diameter_ratio * scale.known_half_width:
            return NONE
        if pair.width < 2.0 * LIMITS.taper_ratio * scale.known_half_width:
            kind = TAPER
    elif n > 8 and shaft.width_count > 0.0:
        ratio = pair.width / (shaft.width_sum / shaft.width_count)
        if ratio > LIMITS.max_widening:
            return NONE
        if ratio < LIMITS.taper_ratio:
            kind = TAPER
    if kind == TAPER and n > 8 and shaft.width_count > 3.0:
        # a tip closes from both sides; where one flank alone moves inward, something crosses the shaft
        narrowing = 0.5 * shaft.width_sum / shaft.width_count - 0.5 * pair.width
        if abs(pair.offset) > LIMITS.one_sided_share * narrowing:
            return NONE
    return kind


@fast
def _extend_gap(image: Raster, sign: float, axis: _Axis, gap: _Gap, step: float, shaft: _Appearance) -> _Gap:
    """Adds one extrapolated step to a gap, and counts whether the shaft's grey level is found on the axis."""
    grey = sign * grey_between(image, min(axis.u, image.right - 1.001), min(axis.v, image.bottom - 1.001))
    if grey > shaft.level - 0.5 * shaft.contrast:
        return _Gap(gap.length + step, gap.start_arc, gap.kept, 0, gap.filled + 1, gap.bare)
    return _Gap(gap.length + step, gap.start_arc, gap.kept, 0, gap.filled, gap.bare + 1)


@fast
def _gains(n: int, deviation: float) -> tuple[float, float, float]:
    """Returns the filter's gains for position, direction and curvature at station ``n`` (0: the first)."""
    if n == 0:
        position, direction, curvature = 1.0, 0.0, 0.0
    elif n < 8:
        count = n + 1.0
        position = max(0.6, 2.0 * (2.0 * count - 1.0) / (count * (count + 1.0)))
        direction = max(0.2, min(0.6, 6.0 / (count * (count + 1.0))))
        curvature = 0.0 if n < 4 else 0.04
    else:
        position, direction, curvature = 0.75, 0.4, 0.1
    if n > 6:
        # a pair of another width is less certain: the edge of a ring, the corner of a cable
        trust = 1.0 / (1.0 + (deviation / 0.06) ** 2)
        position *= max(trust, 0.15)
        direction *= trust
        curvature *= trust
    return position, direction, curvature


@fast
def _correct(predicted: _Axis, pair: _Pair, n: int, run: float, half_width: float) -> _Axis:
    """Moves position, direction and curvature toward the measured centre; ``run`` is the length of a step in px."""
    position_gain, direction_gain, curvature_gain = _gains(n, pair.deviation)
    limit = LIMITS.max_turn / half_width
    curvature = predicted.curvature + curvature_gain * pair.offset / (run * run)
    return _Axis(
        predicted.u + position_gain * pair.offset / pair.slant * pair.normal_u,
        predicted.v + position_gain * pair.offset / pair.slant * pair.normal_v,
        predicted.angle + direction_gain * pair.offset / run,
        min(max(curvature, -limit), limit),
    )


@fast
def _write_station(
    stations: np.ndarray, n: int, predicted: _Axis, pair: _Pair, arc: float, kind: int, shaft: _Appearance
) -> None:
    """Writes the measured pair into row ``n`` of ``stations``."""
    weight = 1.0 / (WEIGHT_FLOOR_PX2 + (0.5 * (pair.width - 2.0 * shaft.half_width)) ** 2)
    if kind != SHAFT:
        weight *= 0.4
    clear = kind != SHAFT or n < 8 or min(pair.left_drop, pair.right_drop) > LIMITS.pale_share * shaft.contrast
    stations[n, U] = predicted.u + pair.offset / pair.slant * pair.normal_u
    stations[n, V] = predicted.v + pair.offset / pair.slant * pair.normal_v
    stations[n, ARC] = arc
    stations[n, WIDTH] = pair.width
    stations[n, WEIGHT] = weight * WEIGHT_FLOOR_PX2
    stations[n, KIND] = kind if clear else PALE


@fast
def _update_appearance(
    image: Raster, sign: float, axis: _Axis, pair: _Pair, kind: int, n: int, shaft: _Appearance
) -> _Appearance:
    """Lets the width follow the measured pair of flanks, and the grey levels where it belongs to a clean shaft.

    ``sign`` is that of the polarity; ``n`` stations were measured.
    """
    half_width, contrast, level, width_sum, width_count = shaft
    if kind == TAPER:
        half_width += 0.5 * (0.5 * pair.width - half_width)
    else:
        half_width += (0.15 if n > 6 else 0.35) * (0.5 * pair.width - half_width)
        if kind == SHAFT and pair.deviation < 0.1:
            contrast += 0.1 * (min(pair.left_drop, pair.right_drop) - contrast)
            width_sum += pair.width
            width_count += 1.0
            u = min(max(axis.u, image.left), image.right - 1.001)
            v = min(max(axis.v, image.top), image.bottom - 1.001)
            inside = sign * grey_between(image, u, v)
            level = inside if width_count == 1.0 else level + 0.2 * (inside - level)
    return _Appearance(half_width, contrast, level, width_sum, width_count)


@fast
def _full_half_width(shaft: _Appearance, scale: _Scale) -> float:
    """Returns the half width of the shaft before its taper: the known one, or the mean of the clear stations."""
    return (
        scale.known_half_width if scale.known_half_width > 0.0 else 0.5 * shaft.width_sum / max(shaft.width_count, 1.0)
    )


@fast
def _close_gap(stations: np.ndarray, n: int, gap: _Gap, half_width: float, scale: _Scale) -> tuple[bool, bool, float]:
    """Decides about a gap after a pair was found behind it.

    Returns:
        Whether the gap is closed, whether it was too long to be accepted, and its length in px.
    """
    if gap.streak < (2 if gap.length <= half_width else 3):
        return False, False, 0.0
    length = stations[gap.kept, ARC] - gap.start_arc
    allowed = scale.max_gap + (4.0 * half_width if gap.filled > gap.bare else 0.0)
    return True, n - gap.streak > 3 and length > allowed + scale.fine_step, length


@fast
def _finish(stations: np.ndarray, n: int, along_border: int, diameter: float, border_u: float, border_v: float) -> None:
    """Recomputes arc lengths, and width and weight of the first stations, when direction and diameter are known."""
    # the first, slanted steps were longer than intended
    for i in range(1, n):
        stations[i, ARC] = stations[i - 1, ARC] + math.hypot(
            stations[i, U] - stations[i - 1, U], stations[i, V] - stations[i - 1, V]
        )
    if n > 0 and along_border > 0:
        far = min(n - 1, max(along_border, 4))
        run_u, run_v = stations[far, U] - stations[0, U], stations[far, V] - stations[0, V]
        upright = abs(border_v * run_u - border_u * run_v) / max(math.hypot(run_u, run_v), 1e-6)
        for i in range(min(n, along_border)):
            stations[i, WIDTH] *= upright
    for i in range(min(n, max(6, along_border))):
        error = 0.5 * (stations[i, WIDTH] - diameter)
        stations[i, WEIGHT] = WEIGHT_FLOOR_PX2 / (WEIGHT_FLOOR_PX2 + error**2) * (0.6 if i < 3 else 1.0)


@fast
def trace_shaft(image: Raster, candidate: Candidate, profile: np.ndarray, stations: np.ndarray) -> TracedShaft:
    """Traces the shaft of one candidate to its end.

    Args:
        image: the frame, and the region that may be read.
        candidate: the entry, and the known properties of the catheter.
        profile: buffer for one profile across a flank, at least 128 numbers.
        stations: (k, 6) array that receives the stations; k limits their number.

    Returns:
        Number of stations, the reason of the end, and the shaft's diameter and contrast.
    """
    sign, heading = candidate.sign, candidate.heading
    known = 0.5 * candidate.diameter if candidate.diameter > 0.0 else 0.0
    step = (candidate.width if known == 0.0 else 2.0 * known) / 3.0
    step = min(max(step, LIMITS.min_step_px), LIMITS.max_step_px)
    fine_step = max(LIMITS.fine_step_share * step, 1.0)
    scale = _Scale(step, fine_step, known, candidate.max_gap, -math.sin(heading), math.cos(heading))
    axis = _Axis(candidate.u, candidate.v, heading, 0.0)
    shaft = _Appearance(0.5 * candidate.width, candidate.contrast, candidate.level, 0.0, 0.0)
    gap = _NO_GAP
    arc = fine_until = blind = lost = 0.0
    taper_start = -1.0
    n = taper_station = along_border = 0
    end = END_TIP
    while n < stations.shape[0]:
        starting = n < LIMITS.first_stations
        h = _choose_step(n, arc, fine_until, gap, scale)
        predicted = _predict(axis, h)
        if not _inside(image, predicted):
            end, lost = END_BORDER, gap.length
            break
        arc += h
        pair = _measure(image, sign, predicted, shaft.half_width, arc, starting, gap.length, scale, profile)
        kind = _classify(image, sign, pair, predicted, n, gap.length, shaft, scale)
        if kind == NONE:
            if gap.length == 0.0 and h > fine_step and not starting:
                # go back and approach in fine steps, to find where exactly the flanks end
                fine_until = arc - 0.5 * fine_step
                arc -= h
                continue
            curvature = axis.curvature
            if gap.length > scale.max_gap:
                curvature *= 1.0 - min(0.5, 0.25 * h / shaft.half_width)
            axis = _Axis(predicted.u, predicted.v, predicted.angle, curvature)
            if gap.length == 0.0:
                if taper_start < 0.0 and shaft.width_count > 3.0:
                    mean_half_width = 0.5 * shaft.width_sum / shaft.width_count
                    shaft = _Appearance(
                        mean_half_width, shaft.contrast, shaft.level, shaft.width_sum, shaft.width_count
                    )
                gap = _Gap(0.0, arc - h, n, 0, 0, 0)
            gap = _extend_gap(image, sign, axis, gap, h, shaft)
            if starting and gap.length > scale.max_gap + 2.0:
                end = END_SHORT
                break
            if gap.length > 2.0 * scale.max_gap + 3.0 * shaft.half_width:
                break
            continue
        _write_station(stations, n, predicted, pair, arc, kind, shaft)
        if n == along_border and pair.normal_u == scale.border_u and pair.normal_v == scale.border_v:
            stations[n, WIDTH] = pair.width / pair.slant
            along_border += 1
        axis = _correct(predicted, pair, n, h if starting else step, shaft.half_width)
        n += 1
        if n == LIMITS.first_stations:
            # the direction of the first stations is that of their centres
            angle = math.atan2(stations[n - 1, V] - stations[0, V], stations[n - 1, U] - stations[0, U])
            axis = _Axis(axis.u, axis.v, angle, axis.curvature)
            upright = max(0.5, scale.border_v * math.cos(angle) - scale.border_u * math.sin(angle))
            shaft = _Appearance(
                shaft.half_width * upright, shaft.contrast, shaft.level, shaft.width_sum, shaft.width_count
            )
        shaft = _update_appearance(image, sign, axis, pair, kind, n, shaft)
        if kind != TAPER:
            taper_start = -1.0
        else:
            if taper_start < 0.0:
                taper_start, taper_station = arc, n
            full = _full_half_width(shaft, scale)
            if arc - taper_start > LIMITS.max_taper_widths * full:
                n = taper_station
                break
            if shaft.half_width < LIMITS.closed_share * full:
                break
        if gap.length > 0.0:
            gap = _Gap(gap.length, gap.start_arc, gap.kept, gap.streak + 1, gap.filled, gap.bare)
            closed, too_long, length = _close_gap(stations, n, gap, shaft.half_width, scale)
            if too_long:
                end, lost, n = END_LOST, length, gap.kept
                break
            if closed:
                blind += length
                gap = _NO_GAP
    if gap.length > 0.0:
        n = gap.kept
    if n < 4:
        end = END_SHORT
    diameter = shaft.width_sum / shaft.width_count if shaft.width_count > 0.0 else 2.0 * shaft.half_width
    _finish(stations, n, along_border, diameter, scale.border_u, scale.border_v)
    last = stations[n - 1, ARC] if n > 0 else 0.0
    return TracedShaft(n, end, diameter, shaft.contrast, last, lost, blind)
