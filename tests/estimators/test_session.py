"""`rod-track`: the force integrated where the shape shows least of it, over a session's constants."""

import math
from typing import Any

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.estimators.session import (
    MODES,
    POINTS,
    Detected,
    Knowledge,
    LineError,
    LineFrame,
    Posterior,
    RodTrack,
    RodTrackSettings,
    SessionFilter,
    StatedErrors,
    _filter,
    noise_unit_m,
    rod_model,
)
from tipforce.estimators.session._filter import taught_contact
from tipforce.estimators.session._mixture import NO_EVIDENCE, _widen_by_profile
from tipforce.estimators.session._noise_level import NoiseLevel
from tipforce.estimators.session._state import (
    GAIN,
    K0,
    PLAY,
    SessionState,
    clipped_moments,
    fill_camera_modes,
    line_modes,
)
from tipforce.estimators.session._walk import Fit, predict
from tipforce.mechanics import PlanarRod
from tipforce.mechanics.planar import UNKNOWNS, Line, make_work, predict_held_line
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.types import (
    ActuationInfo,
    Catheter,
    CentrelinePx,
    DetectedShape,
    FloatArray,
    Observation,
    SessionInfo,
    Status,
    ViewInfo,
)

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


def session(settings: RodTrackSettings = SETTINGS) -> SessionFilter:
    return SessionFilter(settings, Knowledge.stated(settings), rod_model(INFO, settings.segments), INFO)


def image_of(force: tuple[float, float], knob_deg: float = 10.0, across_px: float | FloatArray = 0.0) -> FloatArray:
    """The line of a rod whose clamp is turned by a degree and whose knob asks for 0.2 1/m too little."""
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 0.533 * knob_deg + 0.2, stiffening_curvature_per_m=4.5e-4**-0.5, segments=160)
    points = solve_static(rod, np.array(force)).centreline_m(np.linspace(1.5e-3, 0.048, 64))
    c, s = np.cos(0.017), np.sin(0.017)
    points = points @ np.array([[c, s], [-s, c]]) - (1.5e-3, 0.0)
    image = points / SCALE * (1.0, -1.0) + (-0.5, 239.5)
    image[:, 1] += across_px
    return image


def see(
    state: SessionFilter,
    force: tuple[float, float],
    knob_deg: float = 10.0,
    elapsed_s: float = FRAME_S,
    across_px: float | FloatArray = 0.0,
) -> Posterior:
    return state.step(
        FRAME.line(CentrelinePx(image_of(force, knob_deg, across_px))), SCALE, knob_deg, elapsed_s
    )  # fmt: skip


def width_n(found: Posterior) -> float:
    return float(found.force.high_n[2] - found.force.low_n[2])


@pytest.mark.parametrize("force", [(-0.12, 0.1), (-0.05, -0.08), (-0.3, 0.2), (-0.45, -0.1)])
def test_the_first_frame_holds_the_force(force: tuple[float, float]) -> None:
    found = see(session(), force).force
    assert found.contact > 0.95
    for k, truth in enumerate((*force, math.hypot(*force))):
        assert found.low_n[k] < truth < found.high_n[k]


def test_an_unloaded_rod_is_most_likely_without_contact() -> None:
    found = see(session(), (0.0, 0.0)).force
    assert found.contact < 0.35
    assert np.hypot(*found.force_n) < 0.03


def test_a_push_along_a_straight_shaft_is_left_open() -> None:
    straight = session()
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 0.0, segments=160)
    points = solve_static(rod, np.array([-0.1, 2e-3])).centreline_m(np.linspace(0.0, 0.048, 64))
    line = FRAME.line(CentrelinePx(points / SCALE * (1.0, -1.0) + (-0.5, 239.5)))
    found = straight.step(line, SCALE, 0.0, 0.0)
    assert found.force.high_n[2] > 0.1
    assert width_n(found) > 0.15


def test_frames_without_contact_narrow_the_interval() -> None:
    alone, over_time = session(), session()
    for _ in range(5):
        free = see(over_time, (0.0, 0.0), elapsed_s=1.0)
    assert free.force.contact < 0.05
    first, later = see(alone, (-0.1, 0.08)), see(over_time, (-0.1, 0.08))
    assert width_n(later) < 0.8 * width_n(first)
    assert later.force.low_n[2] < math.hypot(0.1, 0.08) < later.force.high_n[2]


def test_a_line_that_a_push_along_the_shaft_explains_as_well_teaches_both_cases(monkeypatch) -> None:
    """It is most likely without contact; but if it taught so, the session would deny every later push."""
    shares = []

    def taught(*given: float) -> float:
        shares.append(taught_contact(*given))
        return shares[-1]

    monkeypatch.setattr(_filter, "taught_contact", taught)
    state = session()
    found = [see(state, (0.0, 0.0), elapsed_s=1.0).force for _ in range(6)]
    assert max(each.contact for each in found) < 0.1
    assert found[0].high_n[2] > 0.2
    assert 0.4 < shares[0] < 0.6
    assert found[-1].high_n[2] < 0.1, "now a push would be visible"
    assert shares[-1] == 0.0


@pytest.mark.parametrize("free", [0, 4])
@pytest.mark.parametrize("force", [(-0.65, 0.5), (-0.4, -1.0), (-0.9, 0.6)])
def test_a_force_beyond_the_largest_is_refused_and_not_called_none(force: tuple[float, float], free: int) -> None:
    state = session()
    for _ in range(free):
        see(state, (0.0, 0.0), elapsed_s=1.0)
    found = see(state, force)
    assert found.impossible
    assert not found.explained
    after = see(state, (-0.12, 0.1)).force
    assert after.low_n[2] < math.hypot(0.12, 0.1) < after.high_n[2]


def test_frames_in_contact_do_not_move_the_stiffness() -> None:
    """The shape shows force over stiffness: a prior of the force that counts with each frame would move it."""
    state = session()
    for k in range(40):
        size = 0.15 + 0.1 * math.sin(k)
        see(state, (-size, 0.7 * size), elapsed_s=1.0)
    assert state.state is not None
    at, std = state.state.mean[3], math.sqrt(state.state.covariance[3, 3])
    assert abs(at) < std


def test_frames_closer_than_update_s_teach_the_constants_nothing() -> None:
    state = session()
    see(state, (0.0, 0.0))
    assert state.state is not None
    before = state.state.covariance[K0, K0]
    see(state, (0.0, 0.0))
    assert state.state.covariance[K0, K0] >= before
    see(state, (0.0, 0.0), elapsed_s=SETTINGS.update_s)
    assert state.state.covariance[K0, K0] < before


def test_a_shape_that_no_rod_has_changes_nothing() -> None:
    state, other = session(), session()
    for _ in range(3):
        see(state, (0.0, 0.0), elapsed_s=1.0)
        see(other, (0.0, 0.0), elapsed_s=1.0)
    wave = 12 * np.sin(np.linspace(0, 9, 64))
    assert not see(state, (0.0, 0.0), elapsed_s=1e-9, across_px=wave).explained
    one, two = see(state, (-0.1, 0.05)), see(other, (-0.1, 0.05))
    assert one.force.force_n == pytest.approx(two.force.force_n, abs=5e-3)


def test_after_lines_that_no_rod_explains_the_session_is_learnt_anew() -> None:
    state = session()
    for _ in range(4):
        see(state, (0.0, 0.0), elapsed_s=1.0)
    taught = width_n(see(state, (-0.1, 0.08)))
    late = width_n(see(state, (-0.1, 0.08), elapsed_s=2.0 * SETTINGS.gap_s))
    assert late > taught


def test_the_level_of_the_noise_is_learnt_and_one_outlier_is_not_it() -> None:
    usual, outlier, rough = (NoiseLevel(SETTINGS.noise, SETTINGS.level_s) for _ in range(3))
    for k in range(240):
        usual.add(0.1, FRAME_S)
        outlier.add(1e6 if k == 200 else 0.1, FRAME_S)
        rough.add(0.15 * 9.0 / rough.factor**2, FRAME_S)
    assert usual.factor == 1.0
    assert outlier.factor < 1.2
    assert rough.factor == pytest.approx(3.0, rel=0.1)


def test_a_noisier_session_is_followed_with_wider_intervals() -> None:
    found: dict[float, Posterior] = {}
    for noise_px in (0.0, 0.4):
        state, rng = session(), np.random.default_rng(3)
        for _ in range(30):
            wave = noise_px * np.sin(np.linspace(0, 12, 64) + rng.uniform(0, 6.3))
            found[noise_px] = see(state, (-0.1, 0.08), across_px=wave)
    clean, rough = found.values()
    assert clean.level == 1.0
    assert 2.0 < rough.level < SETTINGS.noise.max_level
    assert rough.explained
    assert width_n(rough) > width_n(clean)


def test_the_curvature_follows_the_knob() -> None:
    state = session()
    for _ in range(3):
        see(state, (0.0, 0.0), elapsed_s=1.0)
    for knob in np.linspace(10.0, 20.0, 24):
        found = see(state, (0.0, 0.0), knob_deg=float(knob))
    assert found.explained
    assert found.force.contact < 0.5


@pytest.mark.parametrize(("mean", "std", "half"), [(0.0, 0.3, 0.5), (0.6, 0.3, 0.5), (-1.5, 0.2, 0.5)])
def test_the_moments_of_the_play_are_those_of_clipped_samples(mean: float, std: float, half: float) -> None:
    samples = mean + std * np.random.default_rng(0).standard_normal(400_000)
    clipped = np.clip(samples, -half, half)
    found = clipped_moments(mean, std**2, half)
    assert found[:2] == pytest.approx((clipped.mean(), clipped.var()), abs=2e-3)
    assert found[2] == pytest.approx(np.mean(np.abs(samples) < half), abs=5e-3)


def test_a_knob_that_turns_far_puts_the_mechanism_at_the_end_of_its_play() -> None:
    state = SessionState(SETTINGS, Knowledge.stated(SETTINGS), INFO, 10.0)
    _, before = state.unloaded_curvature_per_m()
    state.predict(SETTINGS, 1.0, 13.0, 0.0)
    assert state.mean[PLAY] == pytest.approx(-0.5, abs=0.02)
    mean, after = state.unloaded_curvature_per_m()
    assert mean == pytest.approx(0.533 * 12.5, abs=0.02)
    assert after < math.hypot(before, 0.2)
    assert state.covariance[GAIN, GAIN] == pytest.approx(SETTINGS.prior.knob_gain**2)


def given(force: tuple[float, float], settings: RodTrackSettings = SETTINGS) -> Any:
    """A stream whose detection finds the same line in each frame."""
    stream: Any = RodTrack(settings).start(INFO)

    class Given:
        shape = DetectedShape(Status.VALID, "", CentrelinePx(image_of(force)))

        def read(self, observation: Observation) -> Detected:
            return Detected(self.shape, FRAME)

    stream._detection = Given()
    return stream


def test_the_one_rule_of_abstention_is_the_width_of_the_interval() -> None:
    estimates = []
    for limit in (None, 1e-3):
        stream = given((-0.1, 0.08), RodTrackSettings(max_error_n=limit))
        estimates.append(stream.update(Observation(0, {}, {"knob_deg": 10.0})))
        assert stream.update(Observation(0, {}, {"knob_deg": 10.0})).status is Status.STALE
    free, narrow = estimates
    assert free.valid
    assert narrow.status is Status.UNOBSERVABLE
    assert narrow.upper_n == pytest.approx(free.magnitude_interval_n[1])


def test_the_refusal_of_a_force_beyond_the_largest_states_the_limit() -> None:
    estimate = given((-0.65, 0.5)).update(Observation(0, {}, {"knob_deg": 10.0}))
    assert estimate.status is Status.OUT_OF_DISTRIBUTION
    assert "larger than prior.largest_force_n = 0.8 N" in estimate.detail


HIDDEN = 16
"""Number of the last of 64 points that something covers."""


def hidden_end(points: FloatArray, wrong_px: float = 0.0) -> DetectedShape:
    """A shape whose last points are hidden, and taken to bend away by ``wrong_px`` at the tip."""
    seen = np.arange(64) < 64 - HIDDEN
    guessed = points.copy()
    guessed[~seen, 1] += wrong_px * np.linspace(0.0, 1.0, HIDDEN) ** 2
    covariance = np.where(seen, 0.05, 4.0)[:, None, None] ** 2 * np.eye(2)
    return DetectedShape(Status.VALID, "", CentrelinePx(guessed), seen=seen, covariance_px2=covariance)


def after_learning(shape: DetectedShape) -> Posterior:
    """The answer for ``shape`` after five seconds without contact."""
    state, detected = session(), Detected(shape, FRAME)
    for _ in range(5):
        see(state, (0.0, 0.0), elapsed_s=1.0)
    return state.step(detected.line(), SCALE, 10.0, FRAME_S, 0.0, detected.errors())


@pytest.mark.parametrize("force", [(-0.1, 0.1), (-0.06, -0.09)])
def test_the_guess_of_a_hidden_end_does_not_count(force: tuple[float, float]) -> None:
    points = image_of(force)
    hidden, misled = (after_learning(hidden_end(points, wrong_px)) for wrong_px in (0.0, 12.0))
    assert hidden.explained
    assert misled.force.force_n == pytest.approx(hidden.force.force_n, abs=2e-3)
    assert hidden.force.low_n[2] < math.hypot(*force) < hidden.force.high_n[2]


def test_points_that_vision_knows_badly_weigh_less() -> None:
    points = image_of((-0.1, 0.1))
    widths = []
    for std_px in (0.01, 0.5):
        covariance = std_px**2 * np.tile(np.eye(2), (64, 1, 1))
        shape = DetectedShape(Status.VALID, "", CentrelinePx(points), covariance_px2=covariance)
        widths.append(width_n(after_learning(shape)))
    assert widths[1] > 1.3 * widths[0]


def test_where_the_line_is_worse_than_stated_visions_statement_is_too_good_as_well() -> None:
    covariance = 0.5**2 * np.tile(np.eye(2), (64, 1, 1))
    shape = DetectedShape(Status.VALID, "", CentrelinePx(image_of((-0.1, 0.1))), covariance_px2=covariance)
    detected, state = Detected(shape, FRAME), session()
    see(state, (0.0, 0.0))
    whiten: list[FloatArray] = []
    for level in (1.0, 3.0):
        state._lay_out_noise(level, begins=True)
        state._fill_noise(detected.line(), detected.errors())
        whiten.append(np.diag(state._whiten)[:POINTS].copy())
    assert (whiten[1] < 0.5 * whiten[0]).all(), "three times the noise, also where vision states most of it"


NOTHING = Fit(math.inf, math.inf, math.nan, math.inf, False)


def test_the_interval_holds_forces_beside_the_walk_that_explain_the_line_as_well() -> None:
    """Pushed across its axis, the tip's force is at the end of the forces that push: the lower end of the magnitude."""
    scratch = session()._scratch
    scratch.forces[0], scratch.across_std[0], scratch.costs[0] = (0.05, 0.01), 0.004, 3.0
    scratch.forces[1], scratch.across_std[1], scratch.costs[1] = (0.05, 0.05), 0.004, 9.0
    low, high = np.full(3, 0.05), np.full(3, 0.05)
    _widen_by_profile(2, -1.0, 0.0, 1.0, 0.0, NOTHING, 0.8, NO_EVIDENCE, low, high, scratch)
    reach = 1.645 * 0.004
    assert low[2] == pytest.approx(math.hypot(0.05 - reach, 0.01), abs=1e-5)
    assert high[2] == pytest.approx(math.hypot(0.05 + reach, 0.01), abs=1e-5)


def drawn_line(state: SessionFilter, rng: np.random.Generator, force: FloatArray) -> Line:
    """A line of the model itself: constants, lasting errors and noise are drawn from their priors."""
    fresh = SessionState(SETTINGS, Knowledge.stated(SETTINGS), INFO, 10.0)
    free = np.diag(fresh.covariance) > 0
    q = fresh.mean.copy()
    q[free] = rng.multivariate_normal(fresh.mean[free], fresh.covariance[np.ix_(free, free)])
    q[:2] = force
    line = FRAME.line(CentrelinePx(image_of((0.0, 0.0))))
    scratch = state._scratch
    error = LineError.of(SETTINGS.noise, MODES)
    unit = noise_unit_m(state._model, SCALE)
    state._modes, state._whiten = line_modes(error, unit), error.whiten / unit
    scratch.rod.theta[:] = np.linspace(0.0, 0.2, len(scratch.rod.theta))
    for _ in range(3):  # the errors of the image depend on where the line is
        fill_camera_modes(state._modes, line, state._model, SETTINGS)
        apart = np.zeros_like(line.points)
        for axis in range(2):
            normals = np.zeros_like(line.points)
            normals[:, axis] = 1.0
            assert predict(q, state._session(fresh), line._replace(normals=normals), scratch)
            apart[:, axis] = scratch.rod.residual[:-1]
        points = line.points - apart
        along = np.gradient(points, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        line = line._replace(points=points, normals=np.stack([-along[:, 1], along[:, 0]], axis=1))
    noise = np.linalg.solve(state._whiten, rng.standard_normal(POINTS + 1))
    points = line.points + noise[:-1, None] * line.normals
    points[-1] += noise[-1] * along[-1]
    return line._replace(points=points)


def test_a_bend_out_of_the_plane_grows_from_the_base_where_the_tip_is_hidden_too() -> None:
    state = session()
    lengths_m, depths = (0.048, 0.03), list[np.ndarray]()
    for length_m in lengths_m:  # a straight line as long as the rod, and the part of it before a hidden end
        points = np.column_stack([np.linspace(0.0, length_m, 60), np.zeros(60)])
        centreline = CentrelinePx(points / SCALE * (1.0, -1.0) + (-0.5, 239.5))
        line = FRAME.line(centreline, from_clamp=length_m < lengths_m[0])
        modes = line_modes(LineError.of(SETTINGS.noise, MODES), noise_unit_m(state._model, SCALE))
        fill_camera_modes(modes, line, state._model, SETTINGS)
        depths.append(np.interp((0.01, 0.02, 0.03), line.points[:, 0], np.abs(modes[:-1, MODES + 3])))
    np.testing.assert_allclose(depths[1], depths[0], rtol=0.02)
    assert depths[0][2] == pytest.approx(9.0 * depths[0][0], rel=0.05)


def test_intervals_hold_on_lines_drawn_from_the_model_itself() -> None:
    rng = np.random.default_rng(3)
    holds, frames = 0, 80
    for _ in range(frames):
        state = session()
        size, turn = rng.uniform(0.02, 0.5), rng.uniform(-1.2, 1.2)
        line = drawn_line(state, rng, size * np.array([-math.cos(turn), -math.sin(turn)]))
        state = session()
        found = state.step(line, SCALE, 10.0, 0.0)
        holds += bool(found.force.low_n[2] <= size <= found.force.high_n[2])
    assert holds >= 0.85 * frames


def test_a_push_that_only_a_held_tip_carries_is_found() -> None:
    """A free tip would give way under such a push: the tissue holds it."""
    state = session()
    for _ in range(5):
        see(state, (0.0, 0.0), elapsed_s=1.0)
    model = rod_model(INFO, SETTINGS.segments)
    work, c, s = make_work(model, 2, len(UNKNOWNS)), math.cos(0.1), math.sin(0.1)
    line, q = FRAME.line(CentrelinePx(image_of((0.0, 0.0)))), np.zeros(len(UNKNOWNS))
    line = line._replace(points=line.points[-2:], normals=line.normals[-2:], from_tip=line.from_tip[-2:])
    q[2], q[5] = 0.533 * 10.0 + 0.2, 4.5e-4
    for push_n in np.linspace(0.0, 0.6, 13):
        q[:2] = -push_n, 4e-3
        assert predict_held_line(q, 0.0, c, s, model, line, np.zeros((3, 0)), work)
    assert work.reaction[1] < 0.0, "a dead load would hold this shape, too"
    force = np.array([-c * 0.6 - s * work.reaction[0], -s * 0.6 + c * work.reaction[0]])
    turn = np.array([[math.cos(0.017), math.sin(0.017)], [-math.sin(0.017), math.cos(0.017)]])
    image = (work.nodes.T @ turn - (1.5e-3, 0.0)) / SCALE * (1.0, -1.0) + (-0.5, 239.5)
    found = state.step(FRAME.line(CentrelinePx(image[2:])), SCALE, 10.0, FRAME_S)
    assert found.explained
    assert np.hypot(*(found.force.force_n - force)) < 0.05
    assert found.force.low_n[2] < math.hypot(*force) < found.force.high_n[2] < 0.75


def test_frames_pushed_across_the_tip_do_not_draw_the_constants_to_larger_pushes() -> None:
    """Such forces are at the end of those that push: if only pushes counted, each frame would draw a little."""
    state = session()
    along = 0.533 * 10.0 * 0.042 + 0.017
    said = []
    for k in range(60):
        size = 0.04 + 0.02 * math.sin(k)
        force = (size * math.sin(along), -size * math.cos(along)) if k % 3 else (0.0, 0.0)
        found = see(state, force, elapsed_s=1.0)
        if k % 3 and k > 30:
            said.append(float(np.hypot(*found.force.force_n)) - size)
    assert np.mean(said) < 0.035  # 0.025; 0.051 if only pushes counted


@pytest.mark.slow
def test_pushes_along_the_shaft_are_not_denied_although_they_look_like_no_contact() -> None:
    """A session pushed at 7 degrees: its line has the true place, but only the error of a detected one is stated."""
    bench = SimulatedBench(PRESETS["varied"], 103000, 45)
    rows = np.flatnonzero(bench.frame_s < 30.0)[::6]
    when, stamps = bench.interpolator, bench.stamp_ns[rows]
    lines = when.lines_m(bench.frame_s[rows])
    pixels = bench.imaging.camera(bench.views[0]).project(lines.reshape(-1, 3)).reshape(*lines.shape[:2], 2)
    forces = when.at(bench.trajectory.contact.force_n, bench.frame_s[rows])
    knob_stamps, knob_deg = bench.knob_log()
    knob_deg = knob_deg[np.searchsorted(knob_stamps, stamps, side="right") - 1]
    info, view = bench.session_info, bench.session_info.view("camera")
    assert view.metres_per_px is not None
    size = bench.settings.width, bench.settings.height
    frame = LineFrame(size, view.base_side or "left", view.metres_per_px, pixels[0, 0])
    state = SessionFilter(SETTINGS, Knowledge.stated(SETTINGS), rod_model(info, SETTINGS.segments), info)
    covariance, held = 0.7**2 * np.tile(np.eye(2), (pixels.shape[1], 1, 1)), []
    for points, force, deg in zip(pixels, forces, knob_deg, strict=True):
        shape = DetectedShape(Status.VALID, "", CentrelinePx(points), covariance_px2=covariance)
        detected = Detected(shape, frame)
        found = state.step(detected.line(), view.metres_per_px, float(deg), 0.2, 0.0, detected.errors()).force
        if np.hypot(*force[:2]) > 0.05:
            held.append(found.low_n[2] <= np.hypot(*force[:2]) <= found.high_n[2])
    assert len(held) > 50
    assert np.mean(held) > 0.85


def test_an_error_in_an_xray_image_is_as_vision_states_it() -> None:
    measured = LineError.of_xray(MODES)
    seen = np.ones(POINTS + 1, np.bool_)
    seen[0] = False
    stated = StatedErrors(np.append(np.full(POINTS, 0.3), 2.0), seen)
    error = measured.as_stated(stated, 0.5).at_level(2.0)
    noise = measured.as_stated(stated, 0.5).covariance_px2
    lasting = np.sum(error.modes**2, axis=1)
    assert np.sqrt(np.diag(noise) + lasting) == pytest.approx(np.append(np.full(POINTS, 0.15), 1.0))
    assert np.diag(error.covariance_px2) == pytest.approx(np.diag(noise) * np.append(np.full(POINTS, 4.0), 1.0))
    kept = np.ix_(seen, seen)
    assert np.allclose(error.whiten[kept] @ error.covariance_px2[kept] @ error.whiten[kept].T, np.eye(POINTS))
    assert not error.whiten[0].any()
    assert error.rows == POINTS
    assert measured.as_stated(None, 0.5) is measured
    unstated = measured.as_stated(StatedErrors(np.zeros(POINTS + 1), np.ones(POINTS + 1, np.bool_)), 0.5)
    assert unstated.covariance_px2 == pytest.approx(measured.covariance_px2)
