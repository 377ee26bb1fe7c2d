"""`rod-track` with the geometry of the contact: direction, depth and the tissue's law that the session learns."""

import math

import numpy as np
import pytest
from tests.estimators.test_session import FRAME, SCALE, image_of, session, width_n
from tests.oracles.planar_rod import solve_static

from tipforce.estimators.session import Posterior, SessionFilter
from tipforce.estimators.session._settings import ContactSettings
from tipforce.estimators.session._tissue import Tissue, evidence_of
from tipforce.mechanics import PlanarRod
from tipforce.types import CentrelinePx, FloatArray
from tipforce.vision.contact import DEPTH_M, PIXEL_M, SIDE_PX, ContactReading, crop_tip, tip_axis
from tipforce.vision.contact._reading import CLEAR_LOGIT, TOUCHED_LOGIT


def reading(
    force: tuple[float, float], points: FloatArray, stiffness: float = 100.0, turned: float = 0.0
) -> ContactReading:
    """What an exact network reads in an image in which the line is at ``points`` and the tissue is linear."""
    axis = points[-1] - points[-4]
    direction = math.atan2(-force[1], force[0])
    depth = math.asinh(math.hypot(*force) / stiffness / DEPTH_M)
    return ContactReading(50.0, 0.5, depth, 0.1, direction - math.atan2(axis[1], axis[0]) + turned, 150.0)


def straight_push(state: SessionFilter, read: bool, turned: float = 0.0) -> tuple[Posterior, float]:
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 0.0, segments=160)
    force = (-0.2, 0.035)
    points = solve_static(rod, np.array(force)).centreline_m(np.linspace(0.0, 0.048, 64))
    image = points / SCALE * (1.0, -1.0) + (-0.5, 239.5)
    seen = reading(force, image, turned=turned) if read else None
    return state.step(FRAME.line(CentrelinePx(image)), SCALE, 0.0, 0.0, reading=seen), math.hypot(*force)


def test_the_direction_shows_a_push_along_a_straight_shaft() -> None:
    without, _ = straight_push(session(), read=False)
    found, truth = straight_push(session(), read=True)
    assert width_n(found) < 0.8 * width_n(without)
    assert found.force.low_n[2] < truth < found.force.high_n[2]
    assert math.hypot(*found.force.force_n) == pytest.approx(truth, rel=0.25)


@pytest.mark.parametrize("turned", [-1.2, 3.1])
def test_a_read_direction_that_the_shape_excludes_does_not_exclude_the_force(turned: float) -> None:
    wrong, truth = straight_push(session(), read=True, turned=turned)
    assert wrong.force.low_n[2] < truth < wrong.force.high_n[2]


def test_the_session_learns_the_stiffness_of_the_tissue() -> None:
    state = session()
    before = state.tissue.stiffness_n_per_m[1]
    for k in range(24):
        size = 0.12 + 0.06 * math.sin(1.7 * k)
        force = (-0.4 * size, size)
        points = image_of(force)
        line = FRAME.line(CentrelinePx(points))
        state.step(line, SCALE, 10.0, 1.0, reading=reading(force, points, stiffness=60.0))
    stiffness, spread = state.tissue.stiffness_n_per_m
    assert stiffness == pytest.approx(60.0, rel=0.35)
    assert spread < 0.7 * before


@pytest.mark.parametrize("stated", [None, 80.0])
def test_the_depth_shows_the_force_where_the_stiffness_is_stated(stated: float | None) -> None:
    tissue = Tissue(ContactSettings(), 0.8, stated)
    deep = ContactReading(50.0, 0.5, math.asinh(2e-3 / DEPTH_M), 0.1, 0.0, 0.0)
    density = tissue.density(deep)
    likely = tissue.force_n[density > 0.5 * density.max()]
    if stated is None:
        assert np.ptp(likely) > 0.4
    else:
        assert tissue.force_n[density.argmax()] == pytest.approx(80.0 * 2e-3, rel=0.25)
        assert np.ptp(likely) < 0.2


@pytest.mark.parametrize("angle", [0.0, 0.9, -2.5])
@pytest.mark.parametrize("scale", [0.1e-3, 0.25e-3])
def test_the_crop_shows_the_tip_at_its_place_with_the_axis_to_the_right(angle: float, scale: float) -> None:
    image, tip = np.zeros((480, 640), np.uint8), np.array([330.0, 260.0])
    ahead = tip + 5e-3 / scale * np.array([math.cos(angle), math.sin(angle)])
    v, u = np.mgrid[:480, :640]
    image[np.hypot(u - ahead[0], v - ahead[1]) < 0.8e-3 / scale] = 255
    crop = crop_tip(image, tip, angle, scale)
    rows, columns = np.nonzero(crop > 127)
    assert crop.shape == (SIDE_PX, SIDE_PX)
    assert (columns.mean(), rows.mean()) == pytest.approx((17e-3 / PIXEL_M + 5e-3 / PIXEL_M, 55.5), abs=0.3)


def test_the_axis_is_that_of_the_rigid_tip() -> None:
    line = np.column_stack([np.linspace(0.0, 200.0, 64), np.zeros(64)])
    line[-10:, 1] = 0.5 * (line[-10:, 0] - line[-10, 0])
    assert tip_axis(line, 0.13e-3) == pytest.approx(math.atan2(0.5, 1.0), abs=0.05)


def outputs(touched: float, clear: float, *others: float) -> FloatArray:
    """The network's outputs, with the distribution of its training images added."""
    return np.array([touched + TOUCHED_LOGIT, clear + CLEAR_LOGIT, 0.0, *others])


def test_outputs_like_the_training_images_are_no_measurement() -> None:
    """A network that sees nothing gives the distribution of its training: it must not count as a reading."""
    nothing = ContactReading.of(outputs(0.0, 0.0, 1.31, math.log(0.72), -2.2, 0.0))
    assert nothing.strength == pytest.approx(0.0, abs=1e-9)
    assert nothing.depth_std > 5.0
    evidence = evidence_of(nothing, 0.3, Tissue(ContactSettings(), 0.8, None), ContactSettings())
    assert evidence.log_odds == pytest.approx(0.0)
    assert np.ptp(evidence.density[1:]) < 0.1


def test_a_sure_reading_is_kept() -> None:
    sure = ContactReading.of(outputs(6.0, 0.0, 2.0, math.log(0.05), -60.0, 20.0))
    assert sure.depth == pytest.approx(2.0, abs=0.01)
    assert sure.depth_std == pytest.approx(0.05, rel=0.01)
    assert sure.turn_rad == pytest.approx(math.atan2(20.0, -57.8), abs=1e-3)
    assert sure.touched == pytest.approx(math.exp(6.0))
    evidence = evidence_of(sure, 0.0, Tissue(ContactSettings(), 0.8, None), ContactSettings())
    assert evidence.log_odds > 1.0
    assert evidence.towards_y < 0.0, "v points down in the image, y up in the frame of the clamp"


def test_a_missing_contact_counts_only_where_the_session_has_shown_its_tissue() -> None:
    apart = ContactReading.of(outputs(-6.0, 0.0, 1.31, math.log(0.72), -2.2, 0.0))
    seen = ContactReading.of(outputs(6.0, 2.0, 1.31, math.log(0.72), -2.2, 0.0))
    empty = ContactReading.of(outputs(-6.0, -4.0, 1.31, math.log(0.72), -2.2, 0.0))
    shown, hidden = (Tissue(ContactSettings(), 0.8, None) for _ in range(2))
    for _ in range(8):
        shown.look(seen, 0.5)
        hidden.look(empty, 0.5)
    assert shown.contact_log_odds(apart) < -3.0
    assert abs(hidden.contact_log_odds(apart)) < 0.1
    assert abs(hidden.contact_log_odds(empty)) < 0.1
