import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.recording import ClockOffset, estimate_offset, find_tare, stated_tare


def elastic(
    offset_s: float,
    *,
    seconds: float = 30.0,
    hz: float = 1.2,
    amplitude: float = 0.2,
    noise: float = 2e-3,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A beat with friction on a wall that lets go now and then, breathing; shape numbers are quadratic in the force.

    Camera time = force stamp + offset. Frames jitter by 2 ms; the force is noisy (3 mN) and comes in steps of 5 mN.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(-1.0, seconds + 1.0, 1e-3)
    normal = amplitude * np.maximum(0.0, 0.4 + np.sin(2 * np.pi * hz * t) + 0.3 * np.sin(2 * np.pi * 0.23 * t))
    friction = 0.2 * np.tanh(40 * np.gradient(normal, t)) * normal
    truth = np.stack([normal * 0.88 - friction * 0.48, normal * 0.48 + friction * 0.88], axis=1)

    def at(when: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(when, t, column) for column in truth.T], axis=1)

    log = np.arange(0.0, seconds, 1e-3)
    force = np.round((at(log) + rng.normal(0, 3e-3, (len(log), 2))) / 5e-3) * 5e-3
    frames = np.arange(0.0, seconds, 1 / 24) + rng.uniform(0, 2e-3, int(np.ceil(seconds * 24)))
    x, y = at(frames).T
    shape = np.stack([3 * y + 0.4 * x + 2 * y**2, x + 0.5 * y - x * y, 0.2 * x + 0.3 * y**2], axis=1)
    shape += rng.normal(0, noise, shape.shape)
    stamps = np.rint((log - offset_s + 100) * 1e9).astype(np.int64)
    readings = np.column_stack([force, np.full(len(log), np.nan)])
    return np.rint((frames + 100) * 1e9).astype(np.int64), shape, stamps, readings


@pytest.mark.parametrize("offset_ms", [-80, -33, 0, 5, 80])
@pytest.mark.parametrize("noise", [2e-3, 2e-2])
def test_the_offset_is_found_to_three_milliseconds(offset_ms: int, noise: float) -> None:
    found = estimate_offset(*elastic(offset_ms * 1e-3, noise=noise, seed=offset_ms + 100))
    assert found.how == "estimated", found.detail
    assert found.offset_ms == pytest.approx(offset_ms, abs=3.0)
    assert found.stderr_ms < 2.0
    assert found.explained > 0.8


def test_the_offset_is_found_though_some_pictures_show_something_else() -> None:
    frames, shape, stamps, force = elastic(0.05)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(shape)) < 0.05
    shape[wrong] = rng.normal(0, 5, (int(wrong.sum()), 3))
    shape[rng.random(len(shape)) < 0.05] = np.nan
    found = estimate_offset(frames, shape, stamps, force)
    assert found.offset_ms == pytest.approx(50, abs=3.0)


def test_an_axis_of_the_sensor_may_be_turned() -> None:
    frames, shape, stamps, force = elastic(-0.02)
    turned = np.column_stack([-force[:, 1], force[:, 0], force[:, 2]])
    assert estimate_offset(frames, shape, stamps, turned).offset_ms == pytest.approx(-20, abs=3.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"amplitude": 0.0}, "too little contact or motion"),
        ({"seconds": 2.0}, "3 s are needed"),
        ({"noise": 5.0}, "too little"),
    ],
)
def test_an_offset_that_cannot_be_told_is_refused(change: dict[str, float], said: str) -> None:
    found = estimate_offset(*elastic(0.03, **change))
    assert (found.how, found.offset_ns) == ("refused", 0)
    assert said in found.detail


def test_a_beat_that_repeats_within_the_window_is_refused() -> None:
    """Five beats a second, all alike: 0.2 s later everything looks the same."""
    t = np.arange(0, 20, 1e-3)
    frames = np.arange(0.5, 19.5, 1 / 24.3)
    force = np.column_stack([np.sin(10 * np.pi * t), 0 * t, 0 * t])
    shape = np.column_stack([np.sin(10 * np.pi * (frames + 0.01)), 0 * frames])
    shape += np.random.default_rng(0).normal(0, 0.01, shape.shape)
    found = estimate_offset(np.rint(frames * 1e9).astype(np.int64), shape, np.rint(t * 1e9).astype(np.int64), force)
    assert found.how == "refused"
    assert "fit alike" in found.detail


def test_an_offset_outside_the_window_is_not_taken_for_one_inside() -> None:
    found = estimate_offset(*elastic(0.5))
    assert found.how == "refused" or abs(found.offset_ms) > 250


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
    assert "--tare" in found.detail
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
    assert ClockOffset.of(ClockOffset(-12_345_678, "estimated", 0.5, 0.9, "").record()).offset_ms == -12.345678
