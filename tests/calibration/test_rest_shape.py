"""The rest shape of a shaft, measured from lines without load."""

from dataclasses import replace

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.calibration import CalibrationSession, calibrate_sessions
from tipforce.calibration._rest_shape import KNOTS, RestShape, fit_rest_shape, rest_quantity
from tipforce.errors import InputError
from tipforce.estimators.session import LineFrame
from tipforce.mechanics import PlanarRod
from tipforce.mechanics.planar import Line
from tipforce.types import Catheter, CentrelinePx, SessionInfo, ViewInfo

SCALE = 2e-4
FRAME = LineFrame((640, 480), "left", SCALE)
INFO = SessionInfo(
    "free",
    Catheter(flexible_length_m=0.04, rigid_length_m=0.008, bending_stiffness_nm2=4.3e-4),
    {"camera": ViewInfo(SCALE, "left")},
)
TRUE_PER_M = np.interp(np.linspace(0.0, 1.0, KNOTS), [0.0, 0.5, 1.0], [14.0, 2.0, -10.0])


def free_line(knob_per_m: float, rng: np.random.Generator, rest_per_m: np.ndarray = TRUE_PER_M) -> Line:
    along = np.interp(np.linspace(0.0, 1.0, 161), np.linspace(0.0, 1.0, KNOTS), rest_per_m)
    rod = PlanarRod(0.04, 4.3e-4, 0.008, along + knob_per_m, segments=160)
    points = solve_static(rod, np.zeros(2)).centreline_m(np.linspace(0.0, 0.048, 64)) / SCALE * (1.0, -1.0)
    smooth = np.interp(np.arange(64), np.linspace(0, 63, 12), rng.normal(0.0, 0.05, 12))
    return FRAME.line(CentrelinePx(points + np.outer(smooth, [0.0, 1.0]) + np.array((-0.5, 239.5))))


def test_the_curvature_along_the_shaft_is_found_within_its_standard_error() -> None:
    rng = np.random.default_rng(4)
    knobs = np.linspace(2.0, 8.0, 20)
    found = fit_rest_shape(INFO, [free_line(knob, rng) for knob in knobs.tolist()], knobs, SCALE)
    assert found.frames == 20
    assert np.abs(found.curvature_per_m - TRUE_PER_M).max() < 0.5
    assert (np.abs(found.curvature_per_m - TRUE_PER_M) < 3.0 * found.std_per_m).all()
    assert found.std_per_m.max() < 3.0, "at the tip, where lines err most"


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(InputError, match="needs 10 frames without contact, got 3"):
        fit_rest_shape(INFO, [free_line(2.0, np.random.default_rng(0))] * 3, np.full(3, 2.0), SCALE)


@pytest.mark.parametrize("bent", [True, False])
def test_calibrate_writes_a_shape_that_is_no_arc(bent: bool, session: CalibrationSession) -> None:
    rng = np.random.default_rng(5)
    rest = TRUE_PER_M if bent else np.zeros(KNOTS)
    count = 24
    knob = session.knob_deg[:count]
    own = replace(session.info, catheter=INFO.catheter)
    free = replace(
        session.subset(np.arange(count)),
        info=own,
        lines=[free_line(0.533 * each, rng, rest) for each in knob.tolist()],
        force_n=np.zeros((count, 2)),
    )
    row = calibrate_sessions([free], rest_shape=True).quantity("rest curvature, mean")
    assert row.key == "catheter.rest_curvature_per_m"
    assert row.written == bent
    if bent:
        found = np.array(row.stated)
        assert np.ptp(found - TRUE_PER_M) < 2.0, "but for a mean, which the knob's offset may hold"
    else:
        assert row.doubt == "not distinguishable from an arc"


def test_a_shape_that_differs_from_an_arc_by_its_standard_errors_is_not_written() -> None:
    found = np.array([-0.9, 0.3, -0.3, 0.0, -0.3, 0.4, -2.8]), np.array([0.75, 0.23, 0.23, 0.25, 0.3, 0.49, 2.5])
    row = rest_quantity([RestShape(*found, 48)], INFO)
    assert (row.written, row.doubt) == (False, "not distinguishable from an arc")
