"""`rod`: forces from a stated stiffness, and when it abstains."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.estimators import Rod, RodSettings, load_model
from tipforce.estimators._reading import Abstention
from tipforce.estimators.rod._detection import Detected
from tipforce.estimators.rod._knowledge import Knowledge
from tipforce.estimators.rod._learning import _maximised, _posterior, _Session
from tipforce.estimators.rod._lines import LineFrame
from tipforce.estimators.rod.rod import RodStream
from tipforce.mechanics import Rod as PlanarRod
from tipforce.mechanics import solve_static
from tipforce.types import (
    ActuationInfo,
    Catheter,
    CentrelinePx,
    DetectedShape,
    Observation,
    SessionInfo,
    Status,
    ViewInfo,
)  # fmt: skip

SCALE = 2e-4
CATHETER = Catheter(flexible_length_m=0.04, rigid_length_m=0.008, bending_stiffness_nm2=4.3e-4)
INFO = SessionInfo("s", CATHETER, {"camera": ViewInfo(SCALE, "left")}, actuation=ActuationInfo(0.533))
FRAME = LineFrame((640, 480), "left", SCALE)


def detected(force: tuple[float, float], knob_deg: float = 10.0, turn: float = 0.0, bend: float = 0.0) -> Detected:
    """The centreline of a rod that comes in at the left border, its clamp 1.5 mm outside, turned by ``turn``."""
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 0.533 * knob_deg, stiffening_curvature_per_m=4.5e-4**-0.5, segments=160)
    points = solve_static(rod, np.array(force)).centreline_m(np.linspace(1.5e-3, 0.048, 64))
    c, s = np.cos(turn), np.sin(turn)
    points = points @ np.array([[c, s], [-s, c]]) - (1.5e-3, 0.0)
    points[:, 1] += bend * np.sin(np.linspace(0.0, 4 * np.pi, 64))
    image = points / SCALE * (1.0, -1.0) + (-0.5, 239.5)
    return Detected(DetectedShape(Status.VALID, "", CentrelinePx(image)), FRAME)


def stream(settings: RodSettings | None = None) -> RodStream:
    made = Rod(settings).start(INFO)
    assert isinstance(made, RodStream)
    return made


@pytest.mark.parametrize("force", [(-0.12, 0.1), (-0.05, -0.08), (-0.15, 0.2)])
def test_the_first_frame_gives_the_force_within_its_covariance(force: tuple[float, float]) -> None:
    found = stream().fit(detected(force, turn=0.01), 10.0)
    assert not isinstance(found, Abstention)
    estimate, covariance, contact = found
    error = estimate - force
    assert error @ np.linalg.solve(covariance, error) < 6.0
    assert np.sqrt(covariance[1, 1]) < 0.05
    assert contact > 0.95


def test_an_unloaded_rod_is_most_likely_without_contact() -> None:
    found = stream().fit(detected((0.0, 0.0)), 10.0)
    assert not isinstance(found, Abstention)
    assert found[2] < 0.2
    assert np.hypot(*found[0]) < 0.01


def test_a_push_along_a_straight_shaft_is_unobservable() -> None:
    found = stream().fit(detected((-0.1, 0.0), knob_deg=0.0), 0.0)
    assert isinstance(found, Abstention)
    assert found.status is Status.UNOBSERVABLE


def test_a_shape_that_no_rod_has_is_refused() -> None:
    found = stream().fit(detected((-0.1, 0.1), bend=1.5e-3), 10.0)
    assert isinstance(found, Abstention)
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "misfit" in found.detail


def test_a_knob_beyond_its_range_is_refused() -> None:
    found = stream().fit(detected((0.0, 0.0)), 1000.0)
    assert isinstance(found, Abstention)
    assert "max_precurvature_per_m" in found.detail


def test_the_force_does_not_depend_on_the_side_that_the_shaft_comes_from() -> None:
    first = detected((-0.12, 0.1))
    assert first.shape.centreline is not None
    left = first.shape.centreline.points
    turned = CentrelinePx(np.stack([639.0 - left[:, 0], 479.0 - left[:, 1]], axis=1))
    other = Detected(replace(first.shape, centreline=turned), LineFrame((640, 480), "right", SCALE))
    forces = [stream().fit(each, 10.0) for each in (first, other)]
    assert not isinstance(forces[0], Abstention)
    assert not isinstance(forces[1], Abstention)
    assert forces[0][0] == pytest.approx(forces[1][0], abs=1e-9)


def test_sessions_with_forces_teach_the_clamp() -> None:
    settings = RodSettings()
    stated = Knowledge.stated(settings)
    forces = [(0.0, 0.0), (-0.1, 0.1), (-0.05, -0.1), (-0.15, 0.15)]
    sessions = []
    for turn in (0.02, 0.022, 0.018, 0.02, 0.021, 0.019):
        lines = [FRAME.line(detected(f, turn=turn).shape.centreline) for f in forces]  # type: ignore[arg-type]
        sessions.append(_Session(INFO, lines, SCALE, np.full(4, 10.0), np.array(forces)))
    found = [_posterior(settings, stated, each) for each in sessions]
    learnt = _maximised(settings, stated, stated, sessions, *map(list, zip(*found, strict=True)))
    at = 8  # the clamp's angle, behind the force
    assert 0.5 * 0.02 < learnt.constants[at] < 1.1 * 0.02
    assert learnt.constants_covariance[at, at] < stated.constants_covariance[at, at]
    assert learnt.sessions == 6


def test_the_name_alone_is_a_model() -> None:
    assert isinstance(load_model("rod"), Rod)


def test_images_without_a_catheter_have_no_force() -> None:
    observation = Observation(0, {"camera": np.full((480, 640), 200, np.uint8)}, {"knob_deg": 10.0})
    found = Rod().start(INFO).update(observation)
    assert not found.valid
    assert found.status is Status.NO_CATHETER
