"""What a known length changes: where the shaft ends, what is followed to there, and what is refused."""

import numpy as np
import pytest

from tipforce.types import Catheter, SessionInfo, Status, ViewInfo
from tipforce.vision import SessionDetector, Tracer, VisionSettings, auto_calibrate, for_session

from .conftest import judge, load  # type: ignore[import-not-found]

tubes = load("tubes")
LENGTH = (260.0, 260.0)
"""Of the curve; the dome reaches a radius further."""
OPEN = VisionSettings(polarity="dark", base_side="left", diameter_px=12.0)
KNOWN = OPEN.model_copy(update={"length_px": 266.0, "length_tolerance": 0.015})
SESSION = SessionInfo("monday", Catheter("test tube", 0.012, 0.234, 0.04), {"camera": ViewInfo(1e-3, "left")})
"""274 px, of which the image shows 97 %."""
NO_METAL = tubes.Look(length=LENGTH, turning=0.12, electrode=190.0, electrode_length=40.0)
"""The metal end has the ground's own grey: only a faint lustre shows."""


def test_an_end_of_the_grounds_own_grey_is_found_by_the_length() -> None:
    assert judge(NO_METAL, range(700, 705), OPEN)[0] <= 1
    assert judge(NO_METAL, range(700, 705), KNOWN) == (5, 0)


def test_what_goes_on_past_the_tip_is_not_followed() -> None:
    """Tissue of the shaft's own grey: its rim looks like the shaft's."""
    look = tubes.Look(length=LENGTH, tissue=60.0)
    assert judge(look, range(720, 726), KNOWN)[1] < judge(look, range(720, 726), OPEN)[1]


def test_a_hidden_stretch_is_crossed_where_what_goes_on_has_the_right_length() -> None:
    look = tubes.Look(length=LENGTH, turning=0.12, gap=30.0, rings=0)
    assert judge(look, range(740, 746), OPEN)[0] == 0
    right, wrong = judge(look, range(740, 746), KNOWN)
    assert right >= 2
    assert wrong == 0


def test_a_shaft_that_ends_too_early_is_refused() -> None:
    look = tubes.Look(length=(200.0, 200.0), turning=1.2)
    for seed in range(760, 764):
        sight = Tracer(KNOWN).detect(tubes.draw(np.random.default_rng(seed), look).image)
        assert sight.status is Status.CUT_OFF


def test_a_shaft_that_goes_on_past_its_length_is_refused() -> None:
    """At full contrast: it is another catheter, or another thing."""
    look = tubes.Look(length=(310.0, 310.0), rings=0)
    for seed in range(770, 776):
        sight = Tracer(KNOWN).detect(tubes.draw(np.random.default_rng(seed), look).image)
        assert not sight.found


def test_a_clear_shaft_is_seen_alike_with_and_without_its_length() -> None:
    tube = tubes.draw(np.random.default_rng(780), tubes.Look(length=LENGTH))
    first, second = Tracer(OPEN).detect(tube.image), Tracer(KNOWN).detect(tube.image)
    assert first.centreline is not None
    assert second.centreline is not None
    np.testing.assert_array_equal(first.centreline.points, second.centreline.points)


def test_auto_calibration_learns_the_length_that_the_session_shows() -> None:
    drawn = [tubes.draw(np.random.default_rng(800 + k), tubes.Look(length=(250.0, 250.0))) for k in range(3)]
    # their bases lie in different places: as if the camera had been set up anew for each
    resolved = auto_calibrate(VisionSettings(), [tube.image for tube in drawn], [SESSION] * 3)
    assert resolved.base_side == "left"
    assert resolved.length_px == pytest.approx(256.0, abs=1.5)
    assert resolved.length_tolerance == 0.01
    assert resolved.nominal_px == (274.0, 12.0)
    assert auto_calibrate(VisionSettings(), [tube.image for tube in drawn]).length_px is None


def test_several_sessions_teach_a_length_that_each_of_them_scales() -> None:
    looks = [tubes.Look(length=(240.0, 240.0)), tubes.Look(length=(300.0, 300.0), diameter=15.0)]
    far, near = SESSION, SessionInfo("tuesday", SESSION.catheter, {"camera": ViewInfo(0.8e-3, "left")})
    drawn = [tubes.draw(np.random.default_rng(820 + k), looks[k % 2]) for k in range(6)]
    resolved = auto_calibrate(VisionSettings(), [tube.image for tube in drawn], [far, near] * 3)
    for session, length in ((far, 246.0), (near, 307.5)):
        assert for_session(resolved, session).length_px == pytest.approx(length, rel=0.01)
    assert resolved.length_tolerance == 0.03


def test_a_shaft_of_another_length_than_the_stated_one_is_not_taken() -> None:
    longer = SessionInfo("monday", Catheter("test tube", 0.012, 0.6, 0.04), {"camera": ViewInfo(1e-3)})
    drawn = [tubes.draw(np.random.default_rng(840 + k), tubes.Look(length=LENGTH)) for k in range(1)]
    images = [tube.image for tube in drawn]
    detector = SessionDetector(VisionSettings(), longer, images)
    assert not any(detector.detect(image).found for image in images)
