"""Lines of views that show no image at an instant, predicted from the lines before.

Views may be exposed in turn, and a view may drop out. Between two images of a view the catheter moves with the force at
its tip. The line of a view is predicted from its last two lines, at their speed. The error of this prediction has two
parts: the errors of both lines, and the motion that a force of unknown acceleration makes.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...types import CentrelinePx, DetectedShape, FloatArray
from ..session import StatedErrors
from ._cameras import ViewLine
from ._settings import SpaceSettings

MAX_LINE_AGE_S = 0.2
"""A line that is older is not used: its prediction then shows as good as nothing of the force."""

_LATE = 1.5
"""An image is late this number of intervals of its view after the one before."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownLine:
    """The line of a view at an instant.

    Attributes:
        line: the line.
        stated: statements of vision about its errors; None: there are none.
        size_px: width and height of the image.
        age_s: time since the image; 0: the view shows this instant.
        interval_s: time between the two lines from which it is predicted; 0: it is the last line itself.
    """

    line: ViewLine
    stated: StatedErrors | None
    size_px: tuple[int, int]
    age_s: float = 0.0
    interval_s: float = 0.0

    @classmethod
    def of(cls, shape: DetectedShape, centreline: CentrelinePx, size_px: tuple[int, int]) -> "ShownLine":
        """Returns the line of a shape that was detected at this instant.

        Args:
            shape: the detected shape.
            centreline: its centreline.
            size_px: width and height of the image.
        """
        return cls(ViewLine.of(centreline), StatedErrors.of(shape), size_px)

    @property
    def overdue(self) -> bool:
        """Whether the next image of the view is late, by the time between its last two."""
        return self.age_s > _LATE * self.interval_s

    @property
    def noise_factor(self) -> float:
        """Factor on the standard deviations of the line's own errors: the prediction has those of two lines."""
        share = self.age_s / self.interval_s if self.interval_s else 0.0
        return math.hypot(1.0 + share, share)

    def force_change_n(self, settings: SpaceSettings) -> float:
        """Returns the standard deviation of each component of the force that the prediction does not contain."""
        if not self.interval_s:
            return settings.force_rate_n_per_s * self.age_s
        return 0.5 * settings.force_acceleration_n_per_s2 * self.age_s * (self.age_s + self.interval_s)


class LineMemory:
    """The last two lines of each view."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._lines: dict[str, list[tuple[float, ShownLine]]] = {}

    def at_next(self, elapsed_s: float, shown: Mapping[str, ShownLine]) -> dict[str, ShownLine]:
        """Returns the lines of all views at the next instant: those that are shown, and predictions of the others.

        Args:
            elapsed_s: time since the last instant.
            shown: lines of the views that show this instant.
        """
        self._now_s += elapsed_s
        for view, line in shown.items():
            self._lines[view] = [*self._lines.get(view, [])[-1:], (self._now_s, line)]
        return dict(shown) | dict(self._predicted(shown))

    def _predicted(self, shown: Mapping[str, ShownLine]) -> Iterator[tuple[str, ShownLine]]:
        """Yields the predicted line of each view that is not ``shown``: its last line, moved on at its last speed.

        Without a usable line before, the last line is yielded where it was. Old lines are left out.
        """
        for view, lines in self._lines.items():
            last_s, last = lines[-1]
            age_s = self._now_s - last_s
            if view in shown or age_s > MAX_LINE_AGE_S:
                continue
            previous_s, previous = lines[0]
            interval_s = last_s - previous_s
            if len(lines) < 2 or interval_s > MAX_LINE_AGE_S or not _same_points(previous, last):
                yield view, ShownLine(last.line, last.stated, last.size_px, age_s)
                continue
            points = last.line.points + (last.line.points - previous.line.points) * (age_s / interval_s)
            yield view, ShownLine(ViewLine.of(CentrelinePx(points)), last.stated, last.size_px, age_s, interval_s)


def _same_points(first: ShownLine, second: ShownLine) -> bool:
    """Returns whether both lines have the same visible points."""
    if first.stated is None or second.stated is None:
        return first.stated is second.stated
    return bool(np.array_equal(first.stated.seen, second.stated.seen))


def whitened_with_motion(whiten: FloatArray, slopes: FloatArray, std_n: float) -> FloatArray:
    """Returns the whitening matrix (rows, rows) of residuals whose noise contains the motion by a change of the force.

    Args:
        whiten: (rows, rows) makes the noise without motion white; zero rows of hidden points stay zero.
        slopes: (rows, 3) derivatives of the residuals by the force.
        std_n: standard deviation of each component of the change.
    """
    motion = whiten @ slopes * std_n
    return np.asarray(np.linalg.solve(np.linalg.cholesky(np.eye(len(whiten)) + motion @ motion.T), whiten), np.float64)
