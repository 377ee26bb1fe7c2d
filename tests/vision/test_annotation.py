"""An annotation holds a line from base to tip, or says that no catheter is in the image."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.vision import Annotation


def test_an_annotation_keeps_its_points_and_cannot_be_changed():
    annotation = Annotation("a.png", np.array([[3, 4], [10, 4], [20, 6]]))
    assert annotation.points_px.dtype == np.float64
    assert not annotation.points_px.flags.writeable


def test_an_image_without_a_catheter_has_no_points():
    assert Annotation("empty.png", np.empty((0, 2)), present=False).points_px.shape == (0, 2)
    assert Annotation("empty.png", np.array([]), present=False).points_px.shape == (0, 2)


@pytest.mark.parametrize(
    ("points", "present", "said"),
    [
        ([[1.0, 2.0]], True, "at least 2 points"),
        ([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], True, "shape \\(2, 3\\)"),
        ([[1.0, 2.0], [np.nan, 3.0]], True, "not a number"),
        ([[1.0, 2.0], [1.0, 2.0]], True, "are the same"),
        ([[1.0, 2.0], [3.0, 4.0]], False, "without a catheter, but it has 2 points"),
    ],
)
def test_points_that_are_no_line_are_refused_with_the_image(points, present, said):
    with pytest.raises(InputError, match=rf"^f7\.png: .*{said}"):
        Annotation("f7.png", np.array(points), present=present)
