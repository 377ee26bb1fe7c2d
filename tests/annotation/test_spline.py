"""The curve through the points that a person drags."""

import numpy as np
import pytest

from tipforce.annotation import curve_through, handles_of

from .conftest import true_line  # type: ignore[import-not-found]

POINTS = np.array([[10.0, 20.0], [60.0, 22.0], [75.0, 60.0], [120.0, 90.0], [121.0, 130.0]])


def test_the_curve_passes_through_the_points_and_is_uniform() -> None:
    curve = curve_through(POINTS, 801)
    assert max(np.linalg.norm(curve - point, axis=1).min() for point in POINTS) < 0.2
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    assert steps.max() < 1.02 * steps.mean()
    assert curve[0].tolist() == POINTS[0].tolist()
    assert curve[-1].tolist() == pytest.approx(POINTS[-1].tolist())


@pytest.mark.parametrize("bend", [0.0, 1.0, 2.5])
def test_few_points_replace_a_detected_line(bend: float) -> None:
    line = true_line(bend)
    handles = handles_of(line)
    assert len(handles) <= 8
    curve = curve_through(handles, 400)
    assert max(np.linalg.norm(curve - point, axis=1).min() for point in line) < 1.3
