import re
from typing import Any

import numpy as np
import pytest

from tipforce.alignment import estimate_clock, find_tare, shape_coordinates, stated_tare
from tipforce.alignment._clock_fit import Force
from tipforce.errors import InputError
from tipforce.io import ClockMap
from tipforce.types import BasePose, CentrelinePx, Status
from tipforce.vision import DetectedShape


def elastic(
    offset_s: float,
    *,
    seconds: float = 20.0,
    hz: float = 1.2,
    amplitude: float = 0.2,
    noise: float = 1e-3,
    turned_deg: float = 0.0,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A beat with friction on a wall that lets go now and then, breathing; the bend follows levers times force.

    Camera time = force stamp + offset. Frames jitter by 2 ms; the force is noisy (3 mN), comes in steps of 5 mN, and
    its sensor is turned by ``turned_deg`` more than stated.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(-1.0, seconds + 1.0, 1e-3)
    beat = 0.4 + np.sin(2 * np.pi * hz * t) + 0.3 * np.sin(2 * np.pi * 0.23 * t)
    normal = amplitude * np.where(t < 3.0, 0.0, np.maximum(0.0, beat))
    friction = 0.2 * np.tanh(40 * np.gradient(normal, t)) * normal
    truth = np.stack([-normal * 0.88 + friction * 0.48, -normal * 0.48 - friction * 0.88], axis=1)

    def at(when: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(when, t, column) for column in truth.T], axis=1)

    log = np.arange(0.0, seconds, 1e-3)
    c, s = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    force = at(log) @ np.array([[c, -s], [s, c]])
    force = np.round((force + rng.normal(0, 3e-3, force.shape)) / 5e-3) * 5e-3
    frames = np.arange(0.0, seconds, 1 / 24) + rng.uniform(0, 2e-3, int(np.ceil(seconds * 24)))
    x, y = at(frames).T
    # the levers get shorter and turn as the shaft bends
    across, along = -30.0 - 40 * y, 90.0 + 50 * y
    moment = across * x + along * y
    bend = 0.15 + 8e-3 * moment - 5e-5 * moment**2 + rng.normal(0, noise, len(x))
    stamps = np.rint((log - offset_s + 100) * 1e9).astype(np.int64)
    coordinates = np.stack([bend, across, along, np.zeros_like(bend)], axis=1)
    return np.rint((frames + 100) * 1e9).astype(np.int64), coordinates, stamps, force


slow = pytest.mark.slow


@pytest.mark.parametrize(
    ("offset_ms", "noise"),
    [
        (5, 1e-2),
        *(pytest.param(*more, marks=slow) for more in ((-80, 1e-3), (-80, 1e-2), (5, 1e-3), (80, 1e-3), (80, 1e-2))),
    ],
)  # fmt: skip
def test_the_offset_is_found_to_three_milliseconds(offset_ms: int, noise: float) -> None:
    found = estimate_clock(*elastic(offset_ms * 1e-3, noise=noise, seed=offset_ms + 100))
    assert found.how == "estimated", found.detail
    assert found.offset_ms == pytest.approx(offset_ms, abs=3.0)
    assert found.stderr_ms < 2.5
    assert found.explained > 0.8


def test_the_offset_is_found_though_some_images_show_something_else() -> None:
    frames, shape, stamps, force = elastic(0.05)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(shape)) < 0.05
    shape[wrong, 0] = rng.normal(0, 1, int(wrong.sum()))
    shape[rng.random(len(shape)) < 0.05] = np.nan
    found = estimate_clock(frames, shape, stamps, force)
    assert found.offset_ms == pytest.approx(50, abs=3.0)


@pytest.mark.parametrize("seeds", [1, pytest.param(4, marks=slow)])
def test_a_degree_of_error_in_the_sensors_angle_costs_little(seeds: int) -> None:
    """The friction of these beats turns round within 2 ms, which a low-pass of the force cannot follow."""
    for turned in (-1.0, 1.0):
        found = [estimate_clock(*elastic(-0.02, turned_deg=turned, seed=seed)) for seed in range(seeds)]
        misses = np.array([each.offset_ms + 20 for each in found])
        assert np.abs(misses).max() < 3.5
        assert np.sqrt(np.mean(misses**2)) < 2.1
        assert (np.abs(misses) < 3 * np.array([each.stderr_ms for each in found])).all()


def test_a_sensor_that_lies_otherwise_than_stated_is_noticed() -> None:
    found = estimate_clock(*elastic(-0.02, turned_deg=60.0))
    assert re.search(r"turned by -?\d+ deg more than stated, or the images are mirrored or turned: check", found.detail)
    assert abs(found.offset_ms + 20) < 6 or found.how == "refused"


def test_a_force_of_the_wrong_sign_is_noticed() -> None:
    frames, shape, stamps, force = elastic(0.01)
    found = estimate_clock(frames, shape, stamps, -force)
    assert "reads tip-on-tissue" in found.detail
    assert found.offset_ms == pytest.approx(10, abs=3.0)


def test_bend_and_levers_are_those_of_the_rod() -> None:
    """A cantilever under a small force across its end: curvature F (l - s) / EI, so B = G / EI."""
    length, stiffness, force = 200.0, 5e5, 0.8
    s = np.linspace(0, length, 65)
    slope = force * (length * s - s**2 / 2) / stiffness
    points = np.stack([s, np.cumsum(np.concatenate([[0], 0.5 * (slope[1:] + slope[:-1]) * np.diff(s)]))], axis=1)
    base = BasePose(np.array([10.0, 300.0]), 0.3)
    seen = DetectedShape(Status.VALID, centreline=CentrelinePx(base.to_image(points)), base=base)
    (bend, across, along, _), lost = shape_coordinates([seen, DetectedShape(Status.NO_CATHETER)])
    assert bend == pytest.approx(along * force * length / stiffness, rel=0.01)
    assert abs(across) < 0.05 * along
    assert np.isnan(lost).all()


def arc(*, tilt_rad: float = 0.0, tip_px: float = 0.0, bend: float = 0.5, diameter: float = 12.0) -> DetectedShape:
    """An arc of 200 px that turns by ``bend``; its base seen tilted, its tip seen sideways by ``tip_px``."""
    s = np.linspace(0, 200, 65)
    angle = bend * s / 200
    points = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0) * (s[1] - s[0])
    points[-1] += tip_px * np.array([-np.sin(bend), np.cos(bend)])
    pose = BasePose(np.array([10.0, 300.0]), 0.3)
    seen = BasePose(pose.origin_px, pose.angle_rad + tilt_rad)
    return DetectedShape(Status.VALID, centreline=CentrelinePx(pose.to_image(points)), base=seen, diameter_px=diameter)


def test_a_tip_that_is_seen_sideways_moves_the_bend_by_nothing() -> None:
    true, seen = shape_coordinates([arc(), arc(tip_px=0.3)])
    assert seen[0] == pytest.approx(true[0], abs=1e-4)  # both are brought to one length
    np.testing.assert_allclose(seen[1:], true[1:], atol=0.3)


def test_a_seen_base_that_turns_with_the_bend_does_not_turn_the_levers() -> None:
    bends = np.linspace(0.0, 0.6, 7)
    still = shape_coordinates([arc(bend=bend) for bend in bends])
    turning = shape_coordinates([arc(bend=bend, tilt_rad=0.05 * (bend - 0.3)) for bend in bends])
    np.testing.assert_allclose(turning, still, atol=1e-9)


def test_bases_on_the_right_have_one_direction_too() -> None:
    """Angles of almost +-180 degrees have a median of their own kind."""
    shown = [arc(tilt_rad=np.pi - 0.3 + turn) for turn in (-0.01, 0.0, 0.01)]
    np.testing.assert_allclose(shape_coordinates(shown)[:, 1:], shape_coordinates([shown[1]] * 3)[:, 1:], atol=1e-9)


def test_levers_end_in_the_middle_of_the_dome() -> None:
    (_, across, along, weight), (_, _, whole, nothing) = shape_coordinates(
        [arc(bend=0.0, diameter=12.0), arc(bend=0.0, diameter=np.nan)]
    )
    assert across == pytest.approx(0.0, abs=1e-9)
    assert whole == along  # a diameter that one image lacks is taken from the others
    assert nothing == weight
    bare = shape_coordinates([arc(bend=0.0, diameter=np.nan)])[0]
    assert bare[2] - along == pytest.approx(weight)
    assert bare[3] == 0.0


@pytest.mark.parametrize("seeds", [1, pytest.param(4, marks=slow)])
def test_the_standard_error_covers_a_noisy_force(seeds: int) -> None:
    """12 mN at 1 kHz, four times that of the bench's sensor."""
    for seed in range(seeds):
        frames, shape, stamps, force = elastic(0.03, hz=1.13, seed=seed)
        noisy = force + np.random.default_rng(seed).normal(0, 12e-3, force.shape)
        found = estimate_clock(frames, shape, stamps, noisy)
        assert abs(found.offset_ms - 30) < min(3.0, 3 * found.stderr_ms)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"amplitude": 0.0}, "too little contact or motion"),
        ({"seconds": 2.0}, "3 s are needed"),
        pytest.param({"noise": 5.0}, "too little", marks=slow),
    ],
)
def test_an_offset_that_cannot_be_told_is_refused(change: dict[str, Any], said: str) -> None:
    found = estimate_clock(*elastic(0.03, **change))
    assert found.how == "refused"
    assert said in found.detail


def test_a_beat_that_repeats_within_the_window_is_refused() -> None:
    """Five beats a second, all alike: 0.2 s later everything looks the same."""
    t = np.arange(0, 20, 1e-3)
    frames = np.arange(0.5, 19.5, 1 / 24.3)
    force = np.column_stack([0 * t, np.sin(10 * np.pi * t)])
    bend = np.sin(10 * np.pi * (frames + 0.01)) + np.random.default_rng(0).normal(0, 0.01, len(frames))
    shape = np.column_stack([bend, 0 * frames, 90 + 0 * frames, 0 * frames])
    found = estimate_clock(np.rint(frames * 1e9).astype(np.int64), shape, np.rint(t * 1e9).astype(np.int64), force)
    assert found.how == "refused"
    assert "fit alike" in found.detail


@pytest.mark.parametrize(("rate", "contradicts"), [(1.0, False), (8.0, True)])
def test_a_beat_that_repeats_contradicts_the_stage_where_no_repetition_is_the_stages(
    rate: float, contradicts: bool
) -> None:
    """Beats all alike, in real time and in slow motion; the stage is on the camera's clock, 3 ms off the truth."""
    t = np.arange(0, 20, 1e-3)
    frames = np.arange(0.5, 19.5, 1 / 24.3)
    force = np.column_stack([0 * t, np.sin(10 * np.pi * t)])
    bend = np.sin(10 * np.pi * (frames + 0.01)) + np.random.default_rng(0).normal(0, 0.01, len(frames))
    shape = np.column_stack([bend, 0 * frames, 90 + 0 * frames, 0 * frames])
    camera_ns, force_ns = np.rint(rate * frames * 1e9).astype(np.int64), np.rint(t * 1e9).astype(np.int64)
    found = estimate_clock(camera_ns, shape, force_ns, force, shared_ns=-207_000_000)
    assert found.how == "refused"
    assert (found.stderr_ms < 18.0) == contradicts
    assert (abs(found.rate - rate) < 0.01 * rate) or not contradicts


@pytest.mark.parametrize("offset_ms", [pytest.param(-1900, marks=slow), pytest.param(500, marks=slow), 3200])
def test_an_offset_of_seconds_is_found(offset_ms: int) -> None:
    found = estimate_clock(*elastic(offset_ms * 1e-3))
    assert found.how == "estimated", found.detail
    assert found.offset_ms == pytest.approx(offset_ms, abs=3.0)


@pytest.mark.parametrize("rate", [8.0, *(pytest.param(rate, marks=slow) for rate in (0.8, 0.998, 1.0004, 1.02, 1.25))])
def test_a_rate_that_is_not_the_nominal_one_is_found(rate: float) -> None:
    """24 images a second stamped as 30, a log that is 0.2 % slow, slow motion by 8."""
    frames, shape, stamps, force = elastic(0.7)
    start = int(frames[0])
    frames = start + np.rint((frames - start) * rate).astype(np.int64)
    found = estimate_clock(frames, shape, stamps, force)
    assert found.how == "estimated", found.detail
    assert abs(found.rate - rate) < 3.0 * found.rate_stderr
    assert found.rate_stderr < 2e-4 * rate
    true = start + rate * (stamps + 0.7e9 - start)
    assert np.abs(found.camera_ns(stamps) - true).max() < 5e6 * rate


def test_clocks_of_one_rate_are_said_to_be_of_one_rate() -> None:
    assert estimate_clock(*elastic(0.01)).rate == 1.0


def test_a_stated_rate_is_kept_and_the_offset_is_found() -> None:
    frames, shape, stamps, force = elastic(0.02)
    found = estimate_clock(frames, shape, stamps, force, rate=1.0)
    assert (found.rate, found.how) == (1.0, "estimated")
    assert found.offset_ms == pytest.approx(20, abs=3.0)


def test_images_that_are_missing_without_a_gap_in_their_stamps_are_noticed() -> None:
    """Three images of the middle are lost, and the rest is stamped without a gap."""
    frames, shape, stamps, force = elastic(0.02)
    cut = len(frames) // 2
    step = int(np.median(np.diff(frames)))
    frames = np.concatenate([frames[:cut], frames[cut + 3 :] - 3 * step])
    found = estimate_clock(frames, np.delete(shape, slice(cut, cut + 3), axis=0), stamps, force)
    assert found.how == "refused"
    assert "off the line" in found.detail or "a clock that jumps" in found.detail


def test_frames_without_a_plausible_force_are_left_out() -> None:
    """A force that is not plausible is no force of zero."""
    frames, shape, stamps, force = elastic(0.03, seconds=30.0)
    bad = (stamps - stamps[0]) % 7_000_000_000 < 1_500_000_000
    force[bad] = np.nan
    found = estimate_clock(frames, shape, stamps, force)
    assert found.offset_ms == pytest.approx(30, abs=3.0)
    assert found.explained > 0.8


def test_the_inertia_of_a_mass_whose_movement_no_log_states_does_not_move_the_offset() -> None:
    frames, shape, stamps, force = elastic(0.03)
    seconds = (stamps - stamps[0]) * 1e-9
    carried = 0.03 * np.sin(2 * np.pi * 1.2 * seconds + 0.8)
    shaken = force + np.outer(carried, [0.88, 0.48])
    plain = estimate_clock(frames, shape, stamps, shaken)
    found = estimate_clock(frames, shape, stamps, shaken, inertial=True)
    assert abs(found.offset_ms - 30) < 2.5 * found.stderr_ms
    assert plain.how == "refused" or abs(plain.offset_ms - 30) > 2.0 * plain.stderr_ms


def test_what_is_left_of_removed_inertia_counts_in_the_standard_error() -> None:
    frames, shape, stamps, force = elastic(0.03)
    left = 0.004 * np.sin(2 * np.pi * 1.2 * (stamps - stamps[0]) * 1e-9 + 0.8)
    shaken = force + np.outer(left, [0.88, 0.48])
    plain = estimate_clock(frames, shape, stamps, shaken)
    found = estimate_clock(frames, shape, stamps, shaken, removed=True)
    assert found.offset_ns == plain.offset_ns
    assert found.stderr_ms > 1.04 * plain.stderr_ms


def log(parts: list[tuple[float, float]], rate: float = 500.0) -> tuple[np.ndarray, np.ndarray]:
    """(seconds, level) pieces; a level of NaN is a beat. Bias (0.3, -0.1), noise 3 mN."""
    rng, pieces = np.random.default_rng(0), []
    for seconds, level in parts:
        t = np.arange(0, seconds, 1 / rate)
        pieces.append(0.1 * (1 - np.cos(2 * np.pi * 1.2 * t)) if np.isnan(level) else np.full(len(t), level))
    push = np.concatenate(pieces)
    force = np.outer(push, [0.6, 0.8, 0.0]) + np.array([0.3, -0.1, 0.0]) + rng.normal(0, 3e-3, (len(push), 3))
    return np.rint(np.arange(len(push)) / rate * 1e9).astype(np.int64), force


@pytest.mark.parametrize(
    "parts",
    [
        [(4, 0.0), (20, np.nan)],
        [(10, np.nan), (3, 0.0), (10, np.nan)],
        [(3, 0.0), (8, np.nan), (4, 0.15), (8, np.nan), (2, 0.0)],
    ],
    ids=["at the start", "in the middle", "beside held contact"],
)
def test_the_contact_free_stretch_is_found(parts: list[tuple[float, float]]) -> None:
    found = find_tare(*log(parts))
    assert found.how == "detected"
    np.testing.assert_allclose(found.force_n, [0.3, -0.1, 0.0], atol=3e-3)
    assert (found.stderr_n < 1e-3).all()
    free, at = [], 0.0
    for seconds, level in parts:
        if level == 0.0:
            free.append((at, at + seconds))
        at += seconds
    assert len(found.stretches_s) == len(free)
    for (start, end), (first, last) in zip(found.stretches_s, free, strict=True):
        assert first - 0.01 <= start < end <= last + 0.01
        assert end - start > 0.7 * (last - first)


def test_without_a_contact_free_stretch_nothing_is_subtracted() -> None:
    found = find_tare(*log([(20, np.nan)]))
    assert found.how == "none"
    assert "tare" in found.detail
    np.testing.assert_array_equal(found.force_n, 0.0)


def test_a_stated_stretch_is_taken_as_it_is() -> None:
    stamps, force = log([(5, 0.0), (5, np.nan)])
    found = stated_tare(stamps, force, 1.0, 4.0)
    assert (found.how, found.stretches_s) == ("stated", ((1.0, 4.0),))
    np.testing.assert_allclose(found.force_n, [0.3, -0.1, 0.0], atol=1e-3)
    with pytest.raises(InputError, match=r"runs from 0 to 10\.0 s"):
        stated_tare(stamps, force, 20.0, 25.0)


def test_the_standard_error_of_the_tare_is_honest() -> None:
    """Over many logs the tare scatters as it says it does, also where noise is slow."""
    misses = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        slow = np.repeat(rng.normal(0, 2e-3, (20, 3)), 100, axis=0)
        force = slow + rng.normal(0, 3e-3, (2000, 3))
        found = stated_tare(np.arange(2000) * 5_000_000, force, 0.0, 10.0)
        misses.append(found.force_n / found.stderr_n)
    assert 0.7 < np.std(misses) < 1.4


def test_an_offset_keeps_its_sign_in_the_file() -> None:
    assert ClockMap.of(ClockMap(-12_345_678, "estimated", 0.5, 0.9, "").record()).offset_ms == -12.345678


def with_rigid_tip(cut_px: float = 0.0, bend: float = 0.5) -> DetectedShape:
    """An arc of 160 px and 40 px of rigid tip, of which the last ``cut_px`` are not seen; less than 0: too much is."""
    s = np.arange(0.0, 200.0 - cut_px + 1e-9, 0.5)
    angle = bend * np.minimum(s, 160.0) / 160.0 + np.where(s > 200.0, 1.2, 0.0)
    points = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0) * 0.5
    pose = BasePose(np.array([10.0, 300.0]), 0.3)
    return DetectedShape(Status.VALID, centreline=CentrelinePx(pose.to_image(points)), base=pose, diameter_px=12.0)


def test_images_that_lack_the_rigid_tip_or_follow_something_behind_it_count_as_the_others() -> None:
    seen = [with_rigid_tip(), with_rigid_tip(), with_rigid_tip(cut_px=36.0), with_rigid_tip(cut_px=-50.0)]
    whole, _, short, long = shape_coordinates(seen, flexible_share=0.8)
    np.testing.assert_allclose(short, whole, rtol=0.02, atol=0.05)
    np.testing.assert_allclose(long, whole, rtol=0.02, atol=0.05)
    usual_is_short = [with_rigid_tip(cut_px=36.0)] * 3 + [with_rigid_tip()]
    np.testing.assert_allclose(
        shape_coordinates(usual_is_short, flexible_share=0.8, length_px=205.0)[0], whole, rtol=0.02, atol=0.05
    )
    assert np.isnan(shape_coordinates([*seen, with_rigid_tip(cut_px=80.0)], flexible_share=0.8)[-1]).all()


def test_a_shaft_that_drifts_slowly_leaves_the_offset_alone() -> None:
    frames, shape, stamps, force = elastic(0.03)
    seconds = (frames - frames[0]) * 1e-9
    shape[:, 0] += 0.3 * np.ptp(shape[:, 0]) * np.sin(2 * np.pi * seconds / 14.0 + 0.4)
    found = estimate_clock(frames, shape, stamps, force)
    assert found.offset_ms == pytest.approx(30, abs=3.0)
    assert found.stderr_ms < 2.5


def test_noise_in_the_force_is_told_from_the_log() -> None:
    rng = np.random.default_rng(0)
    stamps = np.arange(20_000) * 1_000_000
    push = 0.1 * np.sin(2 * np.pi * 1.2 * stamps * 1e-9)
    noise = rng.normal(0, [2e-3, 5e-3], (20_000, 2))
    still, smooth = (Force(stamps * 1e-9, push[:, None] + part) for part in (noise, 0.0 * noise))
    left = still.at(stamps[200:-200] * 1e-9) - smooth.at(stamps[200:-200] * 1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(still.noise)), left.std(axis=1), rtol=0.1)
    assert abs(still.noise[0, 1]) < 0.05 * still.noise[1, 1]
    assert smooth.noise.max() < 1e-3 * still.noise.min(where=np.eye(2, dtype=bool), initial=1.0)
