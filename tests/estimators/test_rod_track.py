"""`rod-track`: zeroes itself, follows the force, keeps to the stamps."""

from typing import Any

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.estimators._recent_share import RecentShare
from tipforce.estimators.rod import RodTrackSettings, _filter
from tipforce.estimators.rod._filter import ContactFilter
from tipforce.estimators.rod._knowledge import Knowledge, rod_model
from tipforce.estimators.rod._lines import LineFrame
from tipforce.estimators.rod._noise_level import NoiseLevel
from tipforce.estimators.rod._outcome import Outcome
from tipforce.mechanics import PlanarRod
from tipforce.mechanics.planar import Found
from tipforce.types import ActuationInfo, Catheter, CentrelinePx, FloatArray, SessionInfo, ViewInfo

SCALE = 2e-4
INFO = SessionInfo(
    "s",
    Catheter(flexible_length_m=0.04, rigid_length_m=0.008, bending_stiffness_nm2=4.3e-4),
    {"camera": ViewInfo(SCALE, "left")},
    actuation=ActuationInfo(0.533),
)
FRAME = LineFrame((640, 480), "left", SCALE)
FRAME_S = 1 / 24
SETTINGS = RodTrackSettings()


def tracker() -> ContactFilter:
    return ContactFilter(SETTINGS, Knowledge.stated(SETTINGS), rod_model(INFO, SETTINGS.segments), INFO)


def see(
    state: ContactFilter,
    force: tuple[float, float],
    knob_deg: float = 10.0,
    elapsed_s: float = FRAME_S,
    across_px: float | FloatArray = 0.0,
) -> Outcome:
    """A frame of a rod whose clamp is turned by a degree and whose knob asks for 0.3 1/m too little."""
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 0.533 * knob_deg + 0.3, stiffening_curvature_per_m=4.5e-4**-0.5, segments=160)
    points = solve_static(rod, np.array(force)).centreline_m(np.linspace(1.5e-3, 0.048, 64))
    c, s = np.cos(0.017), np.sin(0.017)
    points = points @ np.array([[c, s], [-s, c]]) - (1.5e-3, 0.0)
    image = points / SCALE * (1.0, -1.0) + (-0.5, 239.5)
    image[:, 1] += across_px
    line = FRAME.line(CentrelinePx(image))
    return state.step(line, SCALE, knob_deg, elapsed_s)


@pytest.fixture(scope="module")
def zeroed() -> tuple[Outcome, Outcome, Outcome]:
    """The first frame, the last of a second without contact, and the last of half a second in contact."""
    state = tracker()
    free = [see(state, (0.0, 0.0)) for _ in range(24)]
    pressed = [see(state, (-0.1 * k / 12, 0.08 * k / 12)) for k in range(1, 13)]
    return free[0], free[-1], pressed[-1]


def test_what_stays_as_without_a_force_is_taken_for_the_zero(zeroed: tuple[Outcome, Outcome, Outcome]) -> None:
    first, last, _ = zeroed
    assert last.log_odds < min(-3.0, first.log_odds)


def test_from_the_zero_the_force_is_known_better_than_from_one_frame(zeroed: tuple[Outcome, Outcome, Outcome]) -> None:
    first, _, pressed = zeroed
    assert pressed.log_odds > 3.0
    assert pressed.force_n == pytest.approx([-0.1, 0.08], abs=0.03)
    assert np.trace(pressed.covariance_n2) < 0.6 * np.trace(first.covariance_n2)


def test_after_a_gap_less_is_known() -> None:
    state, other = tracker(), tracker()
    for each in (state, other):
        for _ in range(12):
            see(each, (0.0, 0.0))
        for _ in range(12):
            see(each, (-0.05, 0.04))
    soon, late = see(state, (-0.05, 0.04)), see(other, (-0.05, 0.04), elapsed_s=30.0)
    assert np.trace(late.covariance_n2) > np.trace(soon.covariance_n2)


def test_the_curvature_follows_the_knob() -> None:
    state = tracker()
    for _ in range(12):
        see(state, (0.0, 0.0))
    for knob in np.linspace(10.0, 20.0, 24):
        found = see(state, (0.0, 0.0), knob_deg=float(knob))
    assert found.converged
    assert found.log_odds < 0.0


def test_a_shape_that_no_rod_has_changes_nothing() -> None:
    state, other = tracker(), tracker()
    for _ in range(12):
        see(state, (0.0, 0.0))
        see(other, (0.0, 0.0))
    wave = np.stack([np.linspace(0, 220, 64), 240 + 12 * np.sin(np.linspace(0, 9, 64))], axis=1)
    assert state.step(FRAME.line(CentrelinePx(wave)), SCALE, 10.0, 1e-9).misfit > SETTINGS.max_misfit
    one, two = see(state, (0.0, 0.0)), see(other, (0.0, 0.0))
    assert one.force_n == pytest.approx(two.force_n, abs=1e-3)


def test_a_fit_that_fails_breaks_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it leaves for a covariance may be none at all."""
    state, whole = tracker(), _filter.fit_line
    see(state, (0.0, 0.0))

    def failing(*given: Any) -> Found:
        given[-1][:] = np.nan
        return whole(*given[:-1], np.empty_like(given[-1]))._replace(converged=False)

    monkeypatch.setattr(_filter, "fit_line", failing)
    assert not see(state, (-0.1, 0.08)).converged
    monkeypatch.undo()
    assert see(state, (0.0, 0.0)).converged


def test_constants_off_their_priors_let_the_session_begin_anew() -> None:
    settings = RodTrackSettings(max_off=1e-9)
    state = ContactFilter(settings, Knowledge.stated(settings), rod_model(INFO, settings.segments), INFO)
    offs = [see(state, (0.0, 0.0), elapsed_s=0.3).off for _ in range(6)]
    assert min(offs) > settings.max_off
    assert offs[4] == pytest.approx(offs[0], rel=0.01)


def test_the_level_of_the_noise_is_learnt_and_one_outlier_is_not_it() -> None:
    usual, outlier, rough = (NoiseLevel(SETTINGS.noise) for _ in range(3))
    for k in range(240):
        usual.add(0.1, FRAME_S)
        outlier.add(1e6 if k == 200 else 0.1, FRAME_S)
        rough.add(0.15 * 9.0 / rough.factor**2, FRAME_S)
    assert usual.factor == 1.0
    assert outlier.factor < 1.2
    assert rough.factor == pytest.approx(3.0, rel=0.1)


def test_a_noisier_session_is_followed_with_wider_intervals() -> None:
    found: dict[float, Outcome] = {}
    for noise_px in (0.0, 0.4):
        state, rng = tracker(), np.random.default_rng(3)
        for _ in range(30):
            wave = noise_px * np.sin(np.linspace(0, 12, 64) + rng.uniform(0, 6.3))
            found[noise_px] = see(state, (-0.1, 0.08), across_px=wave)
    clean, rough = found.values()
    assert clean.level == 1.0
    assert 2.0 < rough.level < SETTINGS.noise.max_level
    assert rough.misfit < SETTINGS.max_misfit
    assert np.trace(rough.covariance_n2) > np.trace(clean.covariance_n2)


def test_the_share_of_explained_frames_falls_and_recovers_with_its_memory() -> None:
    explained = RecentShare(2.0)
    for _ in range(24):
        explained.add(False, FRAME_S)
    assert explained.value == pytest.approx(np.exp(-0.5), rel=1e-6)
    for _ in range(240):
        explained.add(True, FRAME_S)
    assert explained.value > 0.99
