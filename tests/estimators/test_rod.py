"""`rod`: forces from a stated stiffness, and when it abstains."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.estimators import Estimator, Fusion, FusionSettings, Rod, RodSettings, load_model
from tipforce.estimators._reading import Abstention
from tipforce.estimators.session import (
    Detected,
    Knowledge,
    LineFrame,
    Mixed,
    Posterior,
    Widths,
    noise_unit_m,
    rod_model,
    too_noisy,
)
from tipforce.estimators.session._learning import _maximised, _posterior, _Session
from tipforce.evaluation._methods import methods_from
from tipforce.mechanics import PlanarRod
from tipforce.types import (
    ActuationInfo,
    Catheter,
    CentrelinePx,
    DetectedShape,
    ForceEstimate,
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


class Given:
    """Takes the place of the detection."""

    def __init__(self, found: Detected | Abstention) -> None:
        self._found = found
        self.shape = found.shape if isinstance(found, Detected) else None

    def read(self, observation: Observation) -> Detected | Abstention:
        return self._found


def answer(
    found: Detected, knob_deg: float = 10.0, settings: RodSettings | None = None, info: SessionInfo = INFO
) -> ForceEstimate:
    stream: Any = Rod(settings).start(info)
    stream._detection = Given(found)
    return stream.update(Observation(0, {}, {"knob_deg": knob_deg}))


def posterior(found: Detected, knob_deg: float = 10.0, info: SessionInfo = INFO) -> Posterior:
    stream: Any = Rod().start(info)
    return stream._model.solve(found.line(), SCALE, knob_deg)


@pytest.mark.parametrize("force", [(-0.12, 0.1), (-0.05, -0.08), (-0.15, 0.2)])
def test_the_first_frame_gives_the_force_within_its_interval(force: tuple[float, float]) -> None:
    found = answer(detected(force, turn=0.01))
    assert found.contact > 0.95
    assert found.magnitude_interval_n[0] < np.hypot(*force) < found.magnitude_interval_n[1]
    error = found.force_n[:2] - force
    assert error @ np.linalg.solve(found.covariance_n2[:2, :2], error) < 6.0


def test_a_frame_does_not_depend_on_the_frames_before() -> None:
    stream: Any = Rod().start(INFO)
    alone = answer(detected((-0.12, 0.1)))
    for force in ((0.0, 0.0), (-0.3, -0.1), (-0.12, 0.1)):
        stream._detection = Given(detected(force))
        found = stream.update(Observation(0, {}, {"knob_deg": 10.0}))
    assert found.force_n[:2].tolist() == alone.force_n[:2].tolist()


@pytest.mark.parametrize("force", [(-0.12, 0.1), (-0.08, 0.15)])
def test_the_guess_of_a_hidden_end_does_not_change_the_force(force: tuple[float, float]) -> None:
    found = detected(force)
    assert found.shape.centreline is not None
    points, seen = found.shape.centreline.points, np.arange(64) < 50
    answers = []
    for wrong_px in (0.0, 10.0):
        guessed = points.copy()
        guessed[~seen, 1] += wrong_px * np.linspace(0.0, 1.0, 14)
        shape = replace(found.shape, centreline=CentrelinePx(guessed), seen=seen)
        answers.append(answer(replace(found, shape=shape)))
    assert answers[0].magnitude_interval_n[0] < np.hypot(*force) < answers[0].magnitude_interval_n[1]
    assert answers[1].force_n[:2] == pytest.approx(answers[0].force_n[:2], abs=1e-3)


def test_an_unloaded_rod_is_most_likely_without_contact() -> None:
    found = answer(detected((0.0, 0.0)))
    assert found.contact < 0.35
    assert found.magnitude_n < 0.03


def test_a_push_along_a_straight_shaft_is_left_open_and_no_answer_where_a_width_is_asked_for() -> None:
    straight = detected((-0.1, 0.0), knob_deg=0.0)
    found = answer(straight, knob_deg=0.0)
    assert found.magnitude_interval_n[0] < 0.1 < found.magnitude_interval_n[1]
    assert np.ptp(found.magnitude_interval_n) > 0.2
    limited = answer(straight, knob_deg=0.0, settings=RodSettings(max_error_n=0.1))
    assert limited.status is Status.UNOBSERVABLE
    assert np.isnan(limited.magnitude_n)
    assert limited.upper_n == pytest.approx(found.magnitude_interval_n[1])


def test_a_shape_that_no_rod_has_is_refused() -> None:
    found = answer(detected((-0.1, 0.1), bend=1.5e-3))
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "times the noise that is stated" in found.detail


def test_a_rough_line_is_answered_with_a_wider_interval() -> None:
    clean, rough = (posterior(detected((-0.1, 0.1), bend=bend)) for bend in (0.0, 6e-5))
    assert clean.level == 1.0
    assert 1.5 < rough.level < RodSettings().noise.max_level
    assert rough.force.high_n[2] - rough.force.low_n[2] > clean.force.high_n[2] - clean.force.low_n[2]


def test_a_rod_far_off_what_is_stated_is_refused() -> None:
    found = answer(detected((-0.12, 0.1), turn=0.45))
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "from their stated values" in found.detail
    assert "max_misfit" in found.detail
    limit = 2.0 * RodSettings().max_misfit
    assert answer(detected((-0.12, 0.1), turn=0.1), settings=RodSettings(max_misfit=limit)).valid


def test_a_level_beyond_its_limit_is_refused() -> None:
    refused = too_noisy(RodSettings(), 11.0)
    assert refused is not None
    assert refused.status is Status.OUT_OF_DISTRIBUTION
    assert "noise.max_level" in refused.detail


def test_a_knob_beyond_its_range_is_refused() -> None:
    found = answer(detected((0.0, 0.0)), 1000.0)
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "max_precurvature_per_m" in found.detail


def test_the_force_does_not_depend_on_the_side_that_the_shaft_comes_from() -> None:
    first = detected((-0.12, 0.1))
    assert first.shape.centreline is not None
    left = first.shape.centreline.points
    turned = CentrelinePx(np.stack([639.0 - left[:, 0], 479.0 - left[:, 1]], axis=1))
    other = Detected(replace(first.shape, centreline=turned), LineFrame((640, 480), "right", SCALE))
    forces = [answer(each).force_n[:2] for each in (first, other)]
    assert forces[0] == pytest.approx(forces[1], abs=1e-6)


def test_calibrated_widths_multiply_intervals_and_covariance() -> None:
    force, std = np.array([-0.2, 0.1]), np.array([0.02, 0.01])
    size = math.hypot(*force)
    low, high = np.append(force - 1.645 * std, size - 0.03), np.append(force + 1.645 * std, size + 0.03)
    mixed = Mixed(force, np.diag(std**2), 1.0, low, high, 0.0)
    one, two = Widths().estimate(0, mixed, None), Widths(2.0, 3.0, 2.0).estimate(0, mixed, None)
    assert np.ptp(two.interval_n[:2], axis=1) == pytest.approx([2.0, 3.0] * np.ptp(one.interval_n[:2], axis=1))
    assert np.ptp(two.magnitude_interval_n) == pytest.approx(2.0 * np.ptp(one.magnitude_interval_n))
    assert two.covariance_n2[1, 1] == pytest.approx(9.0 * one.covariance_n2[1, 1])


@pytest.mark.parametrize("method", [Rod(RodSettings(max_error_n=0.1)), Fusion(FusionSettings(max_error_n=0.1))])
def test_intervals_are_found_on_all_estimates_however_wide(method: Estimator, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float | None] = []

    def predict(self: Any, *_: object) -> list[ForceEstimate]:
        asked.append(self.settings.max_error_n)
        raise StopIteration

    monkeypatch.setattr(type(method), "predict", predict)
    with pytest.raises(StopIteration):
        method.calibrate(SimpleNamespace(known=np.ones(3, np.bool_)))  # type: ignore[arg-type]
    assert asked == [None]
    assert method.settings.max_error_n == 0.1  # type: ignore[attr-defined]


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
    assert 0.5 * 0.02 < learnt.constants[at] < 1.15 * 0.02
    assert learnt.constants_covariance[at, at] < stated.constants_covariance[at, at]
    assert learnt.sessions == 6


def test_how_well_the_bench_is_known_is_the_prior_and_narrows_the_interval() -> None:
    exact = replace(CATHETER, bending_stiffness_uncertainty=0.001, flexible_length_uncertainty=0.001)
    poor = replace(CATHETER, bending_stiffness_uncertainty=0.1, flexible_length_uncertainty=0.04)
    known, settings = Knowledge.stated(RodSettings()), RodSettings()
    widths = []
    for catheter in (exact, poor):
        info = replace(INFO, catheter=catheter)
        _, covariance = known.for_session(settings, info, 10.0)
        assert covariance[4, 4] == pytest.approx(catheter.flexible_length_uncertainty**2)
        assert covariance[1, 1] == pytest.approx(catheter.bending_stiffness_uncertainty**2 + 0.025**2)
        assert covariance[5, 5] == settings.prior.scale**2, "of which nothing is said"
        widths.append(np.ptp(answer(detected((-0.2, 0.2)), info=info).magnitude_interval_n))
    assert widths[1] > 1.2 * widths[0]
    learnt = replace(known, sessions=6)
    covariance = learnt.for_session(settings, replace(INFO, catheter=poor), 10.0)[1]
    assert covariance[1, 1] == known.constants_covariance[1, 1], "sessions with forces tell more than the data sheet"


def test_the_name_alone_is_a_model() -> None:
    assert isinstance(load_model("rod"), Rod)


def test_a_folder_of_the_same_name_that_holds_no_model_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rod").mkdir()
    monkeypatch.chdir(tmp_path)
    assert isinstance(load_model("rod"), Rod)
    assert [type(method.estimator) for method in methods_from(["rod"])] == [Rod]


def test_images_without_a_catheter_have_no_force() -> None:
    observation = Observation(0, {"camera": np.full((480, 640), 200, np.uint8)}, {"knob_deg": 10.0})
    found = Rod().start(INFO).update(observation)
    assert not found.valid
    assert found.status is Status.NO_CATHETER


def test_a_finer_image_does_not_tell_more_than_the_bench_that_the_noise_was_measured_on() -> None:
    model = rod_model(INFO, 40)
    assert noise_unit_m(model, 1e-4) == pytest.approx(2e-4)
    assert noise_unit_m(model, 3e-4) == pytest.approx(3e-4)
