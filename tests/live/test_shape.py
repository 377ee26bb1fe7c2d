"""The catheter's shape beside the force of a method that detects none."""

import numpy as np
import pytest

from tipforce.live._shape import ShapeFinder
from tipforce.types import DetectedShape, SessionInfo, Status, ViewInfo
from tipforce.vision import RESOLVED_AFTER_IMAGES

from .conftest import Camera, Method, Notes


def test_the_shape_is_found_once_the_first_images_have_resolved_how(tube):
    finder = ShapeFinder("camera", SessionInfo(views={"camera": ViewInfo(metres_per_px=5e-4)}))
    images = [tube("bent", noise=2.0), tube("hook", noise=2.0), tube("straight", noise=2.0)]
    found = None
    for number in range(400):
        found = finder.find(images[number % 3])
        if found is not None:
            break
    assert number == 50 + RESOLVED_AFTER_IMAGES - 1
    for image in images:
        assert finder.find(image).found
    rest = finder.find(images[2])
    advanced = np.concatenate([np.repeat(images[2][:, :1], 20, axis=1), images[2][:, :-20]], axis=1)
    followed = finder.find(advanced, 10.0)  # of a clamp that stands 20 px farther in
    assert followed.base.origin_px == pytest.approx(rest.base.origin_px + np.array([20.0, 0.0]), abs=0.5)
    assert followed.centreline.points[-1] == pytest.approx(rest.centreline.points[-1] + np.array([20.0, 0.0]), abs=0.5)
    blank = finder.find(np.full((480, 640), 220, np.uint8))
    assert not blank.found
    finder.close()


def test_a_detection_that_fails_costs_the_drawing_and_not_the_force(engine):
    class Broken:
        def find(self, image, advance_mm):
            raise ZeroDivisionError

    notes = Notes()
    live = engine(Camera(30), Method(), notes)
    live._shapes = Broken()
    report = live.run()
    assert report.valid > 0
    assert live._shapes is None


def test_the_shape_of_the_engine_goes_out_with_the_estimate(engine):
    shape = DetectedShape(Status.NO_CATHETER, "nothing there")

    class Finds:
        def find(self, image, advance_mm):
            return shape

        def close(self):
            pass

    notes = Notes()
    live = engine(Camera(30), Method(), notes)
    live._shapes = Finds()
    live.run()
    assert all(each.estimate.shape is shape for each in notes.updates if each.estimate.valid)
