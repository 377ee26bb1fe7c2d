"""The catheter's tip in two views of a recording, at the same instants."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..io import RecordingReader, spread_images
from ..types import FloatArray, IntArray, SessionInfo
from ..vision import SessionDetector, VisionSettings
from ._relative_pose import TipPairs

MAX_INSTANTS = 150
"""Largest number of instants of one recording in which the tip is detected; they are spread over it."""
MAX_GAP_PERIODS = 2.5
"""The tip of the second view is interpolated between frames that are at most this many periods apart."""
SAME_INSTANT_NS = 1_000_000
"""Exposures of both views that differ by at most this time need no interpolation."""
_AXIS_SHARE = 0.1
"""Share of the detected line next to the tip that defines the direction of the catheter there."""


def read_tip_pairs(
    path: Path, views: tuple[str, str], info: SessionInfo, progress: Callable[[float], None] | None = None
) -> TipPairs:
    """Detects the tip in both views of a recording.

    Where the second view was exposed at other instants, its tip is interpolated to those of the first view.

    Args:
        path: the recording.
        views: the first and the second view.
        info: session metadata.
        progress: called with the share that is done.

    Returns:
        The tips in the frames in which it is visible in both views.

    Raises:
        FileFormatError: the recording cannot be read.
    """
    with RecordingReader(path) as reader:
        stamps = [reader.stamps(view) for view in views]
        stride = max(1, -(-len(stamps[0]) // MAX_INSTANTS))
        rows = np.arange(0, len(stamps[0]), stride)
        pairs = [_bracket(stamps[1], int(stamps[0][row])) for row in rows]
        bracketed = [(int(row), pair) for row, pair in zip(rows, pairs, strict=True) if pair is not None]
        needed_rows = [
            sorted({row for row, _ in bracketed}),
            sorted({row for _, (low, high, _) in bracketed for row in (low, high)}),
        ]
        total, detected = sum(map(len, needed_rows)), 0
        tips: list[dict[int, FloatArray]] = [{}, {}]
        for index, view in enumerate(views):
            detector = SessionDetector(VisionSettings(view=view), info, spread_images(reader, view))
            for row in needed_rows[index]:
                shape = detector.detect(reader.frame_at(row, view).image)
                if shape.centreline is not None and shape.tip_seen:
                    line = shape.centreline.points
                    axis = line[-1] - line[-1 - max(1, round(_AXIS_SHARE * len(line)))]
                    tips[index][row] = np.array([line[-1], axis / np.linalg.norm(axis)])
                detected += 1
                if progress is not None:
                    progress(detected / total)
    both_tips: list[FloatArray] = []
    for row, (low, high, share) in bracketed:
        if row in tips[0] and low in tips[1] and high in tips[1]:
            both_tips.append(np.stack([tips[0][row], (1.0 - share) * tips[1][low] + share * tips[1][high]]))
    tips_and_axes = np.array(both_tips).reshape(-1, 2, 2, 2)
    axes = tips_and_axes[:, :, 1]
    return TipPairs(tips_and_axes[:, :, 0], axes / np.linalg.norm(axes, axis=2, keepdims=True))


def _bracket(stamps_ns: IntArray, at_ns: int) -> tuple[int, int, float] | None:
    """Returns the rows before and after an instant, and the share of the second one; None where they are too far."""
    if not len(stamps_ns):
        return None
    nearest = int(np.abs(stamps_ns - at_ns).argmin())
    if abs(int(stamps_ns[nearest]) - at_ns) <= SAME_INSTANT_NS:
        return nearest, nearest, 0.0
    high = int(np.searchsorted(stamps_ns, at_ns))
    if high == 0 or high == len(stamps_ns):
        return None
    gap = int(stamps_ns[high] - stamps_ns[high - 1])
    if gap > MAX_GAP_PERIODS * float(np.median(np.diff(stamps_ns))):
        return None
    return high - 1, high, (at_ns - int(stamps_ns[high - 1])) / gap
