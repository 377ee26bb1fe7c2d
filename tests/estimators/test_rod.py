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
from tipforce.estimators.rod._calibration import Widths
from tipforce.estimators.rod._detection import Detected
from tipforce.estimators.rod._knowledge import Knowledge, noise_unit_m, rod_model
from tipforce.estimators.rod._learning import _maximised, _posterior, _Session
from tipforce.estimators.rod._lines import LineFrame
from tipforce.estimators.rod._outcome import Outcome, estimate_of, tempered
from tipforce.estimators.rod._posterior import ForcePrior, force_over_contact
from tipforce.estimators.rod.rod import RodStream
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


def answer(found: Detected, knob_deg: float = 10.0) -> ForceEstimate:
    outcome = stream().fit(found, knob_deg)
    assert isinstance(outcome, Outcome)
    return estimate_of(RodSettings(), Widths(), 0, outcome, None)


def stream(settings: RodSettings | None = None) -> RodStream:
    made = Rod(settings).start(INFO)
    assert isinstance(made, RodStream)
    return made


@pytest.mark.parametrize("force", [(-0.12, 0.1), (-0.05, -0.08), (-0.15, 0.2)])
def test_the_first_frame_gives_the_force_within_its_covariance(force: tuple[float, float]) -> None:
    found = answer(detected(force, turn=0.01))
    error, covariance = found.force_n[:2] - force, found.covariance_n2[:2, :2]
    assert error @ np.linalg.solve(covariance, error) < 6.0
    assert np.sqrt(covariance[1, 1]) < 0.05
    assert found.contact > 0.95
    assert found.magnitude_interval_n[0] < np.hypot(*force) < found.magnitude_interval_n[1]


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


def test_a_push_along_a_straight_shaft_is_unobservable() -> None:
    found = answer(detected((-0.1, 0.0), knob_deg=0.0), knob_deg=0.0)
    assert found.status is Status.UNOBSERVABLE
    assert np.isnan(found.magnitude_n)
    assert found.upper_n > RodSettings().max_std_n  # the shape leaves it open: it may be as large as that


def test_a_shape_that_no_rod_has_is_refused() -> None:
    found = answer(detected((-0.1, 0.1), bend=1.5e-3))
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "misfit" in found.detail


def test_a_rough_line_is_answered_with_a_wider_interval() -> None:
    clean, rough = (stream().fit(detected((-0.1, 0.1), bend=bend), 10.0) for bend in (0.0, 6e-5))
    assert isinstance(clean, Outcome)
    assert isinstance(rough, Outcome)
    assert clean.level == 1.0
    assert 1.5 < rough.level < RodSettings().noise.max_level
    assert np.trace(rough.covariance_n2) > 1.2 * np.trace(clean.covariance_n2)
    widths = [estimate_of(RodSettings(), Widths(), 0, each, None).magnitude_interval_n for each in (clean, rough)]
    assert np.diff(widths[1]) > np.diff(widths[0])


def test_a_level_beyond_its_limit_is_refused() -> None:
    found = stream().fit(detected((-0.1, 0.1)), 10.0)
    assert isinstance(found, Outcome)
    refused = estimate_of(RodSettings(), Widths(), 0, found._replace(level=11.0), None)
    assert refused.status is Status.OUT_OF_DISTRIBUTION
    assert "noise.max_level" in refused.detail


def test_an_interval_that_reaches_too_far_is_no_answer() -> None:
    found = stream().fit(detected((-0.1, 0.1)), 10.0)
    assert isinstance(found, Outcome)
    refused = estimate_of(RodSettings(max_error_n=1e-3), Widths(), 0, found, None)
    assert refused.status is Status.UNOBSERVABLE


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
    forces = [answer(each).force_n[:2] for each in (first, other)]
    assert forces[0] == pytest.approx(forces[1], abs=1e-9)


def test_a_rod_far_off_what_is_stated_is_refused() -> None:
    found = stream().fit(detected((-0.12, 0.1)), 10.0)
    assert isinstance(found, Outcome)
    off = found._replace(off=1.01 * RodSettings().max_off)
    assert estimate_of(RodSettings(), Widths(), 0, found, None).valid
    refused = estimate_of(RodSettings(), Widths(), 0, off, None)
    assert refused.status is Status.OUT_OF_DISTRIBUTION
    assert "max_off" in refused.detail


def gaussian(std: float) -> ForcePrior:
    """A prior that is the one of the fit."""
    return ForcePrior(std, std, 1e6)


def test_a_force_that_is_surely_there_keeps_its_gaussian() -> None:
    force, covariance = np.array([-0.3, 0.1]), np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    found = force_over_contact(force, covariance, 0.0, 50.0, gaussian(0.25))
    assert found.force_n == pytest.approx(force, abs=1e-4)
    assert found.covariance_n2 == pytest.approx(covariance, rel=0.01, abs=1e-6)
    assert found.high_n[0] == pytest.approx(-0.3 + 1.645 * 0.02, rel=0.02)
    assert found.low_n[0] == pytest.approx(-0.3 - 1.645 * 0.02, rel=0.02)


def test_a_heavy_tail_draws_a_large_force_less_to_the_usual_ones() -> None:
    # likelihood: -0.4 +- 0.1 N; the fit's prior has drawn it to -0.345
    fitted, noise = 0.25, 0.1
    share = fitted**2 / (fitted**2 + noise**2)
    force, covariance = np.array([-0.4 * share, 0.0]), np.diag([share * noise**2, 1e-6])
    light = force_over_contact(force, covariance, 0.0, 50.0, ForcePrior(fitted, 0.12, 1e6))
    heavy = force_over_contact(force, covariance, 0.0, 50.0, ForcePrior(fitted, 0.12, 3.0))
    assert -0.4 < heavy.force_n[0] < light.force_n[0]
    assert heavy.high_n[2] > 0.4


def test_no_contact_is_an_atom_of_the_mixture() -> None:
    force, covariance = np.array([-0.2, 0.0]), np.diag([4e-4, 1e-6])
    found = force_over_contact(force, covariance, 0.0, -math.log(2.0), gaussian(0.25))
    assert found.contact == pytest.approx(0.5, abs=1e-6)
    assert found.force_n[0] == pytest.approx(-0.1, abs=1e-4)
    assert found.low_n[2] == 0.0
    assert found.high_n[2] == pytest.approx(0.2 + 1.28 * 0.02, rel=0.03)


def test_forces_that_pull_at_the_tip_are_excluded() -> None:
    covariance = np.diag([1e-2, 1e-6])
    found = force_over_contact(np.array([0.05, 0.0]), covariance, 0.0, 50.0, gaussian(0.25))
    assert found.force_n[0] < 0.0
    assert found.high_n[0] <= 0.0
    pulled = force_over_contact(np.array([0.5, 0.0]), 1e-4 * np.eye(2), 0.0, 0.0, gaussian(0.25))
    assert pulled.contact == 0.0
    assert pulled.force_n == pytest.approx([0.0, 0.0])


def test_calibrated_widths_multiply_intervals_and_covariance() -> None:
    mixed = force_over_contact(np.array([-0.2, 0.1]), np.diag([4e-4, 1e-4]), 0.0, 50.0, gaussian(0.25))
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
    assert 0.5 * 0.02 < learnt.constants[at] < 1.1 * 0.02
    assert learnt.constants_covariance[at, at] < stated.constants_covariance[at, at]
    assert learnt.sessions == 6


def test_how_well_the_bench_is_known_is_the_prior_and_widens_the_covariance() -> None:
    exact = replace(INFO.catheter, bending_stiffness_uncertainty=0.001, flexible_length_uncertainty=0.001)
    poor = replace(INFO.catheter, bending_stiffness_uncertainty=0.1, flexible_length_uncertainty=0.04)
    known, settings = Knowledge.stated(RodSettings()), RodSettings()
    stds = []
    for catheter in (exact, poor):
        _, covariance = known.for_session(settings, replace(INFO, catheter=catheter), 10.0)
        assert covariance[4, 4] == pytest.approx(catheter.flexible_length_uncertainty**2)
        assert covariance[1, 1] == pytest.approx(catheter.bending_stiffness_uncertainty**2 + 0.025**2)
        assert covariance[5, 5] == settings.prior.scale**2, "of which nothing is said"
        info = replace(INFO, catheter=catheter)
        found = Rod().start(info).fit(detected((-0.05, 0.15)), 10.0)  # type: ignore[attr-defined]
        stds.append(np.sqrt(np.linalg.eigvalsh(found.covariance_n2))[0])
    assert stds[1] > 1.5 * stds[0]
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


def test_what_speaks_against_contact_counts_less_where_the_force_is_open() -> None:
    wide, narrow = np.diag([0.1**2, 1e-6]), np.diag([1e-6, 1e-6])
    assert tempered(-4.0, wide, 0.02) > -0.2
    assert tempered(-4.0, narrow, 0.02) == pytest.approx(-4.0, rel=0.01)
    assert tempered(4.0, wide, 0.02) == 4.0


def test_a_finer_image_does_not_tell_more_than_the_bench_that_the_noise_was_measured_on() -> None:
    model = rod_model(INFO, 40)
    assert noise_unit_m(model, 1e-4) == pytest.approx(2e-4)
    assert noise_unit_m(model, 3e-4) == pytest.approx(3e-4)
