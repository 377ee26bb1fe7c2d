import numpy as np
import pytest

from tipforce.alignment import StageMotion, find_plausible_force
from tipforce.io import Inertia, Tare
from tipforce.plausibility import ForcePlausibility, find_zero_steps

from .bench_log import BIAS_N, bench_log  # type: ignore[import-not-found]

STILL = StageMotion(np.empty(0, np.int64), {})


def found_in(
    stamps: np.ndarray, force: np.ndarray, tare: tuple[float, float] = (0.0, 3.0)
) -> tuple[ForcePlausibility, Tare, Inertia]:
    return find_plausible_force(stamps, force, STILL, tare, [])


@pytest.mark.parametrize("rate_hz", [1000.0, 100.0])
@pytest.mark.parametrize("at_s", [7.13, 11.7, 16.4])
def test_a_pressed_zero_is_found_and_corrected(rate_hz: float, at_s: float) -> None:
    stamps, force = bench_log(rate_hz=rate_hz)
    row = round(at_s * rate_hz)
    step = -force[row]
    spoiled = force.copy()
    spoiled[row:] += step
    found, tare, _ = found_in(stamps, spoiled)
    (finding,) = found.findings
    assert finding.kind == "step of the zero"
    assert finding.start_s == pytest.approx(at_s, abs=1.5 / rate_hz)
    assert finding.size_n == pytest.approx(np.linalg.norm(step), abs=0.01)
    assert "is corrected" in finding.detail
    assert np.abs(found.corrected(stamps, spoiled) - force).max() < 0.01
    np.testing.assert_allclose(tare.force_n, BIAS_N, atol=1e-3)


def test_the_tare_may_lie_behind_the_step() -> None:
    stamps, force = bench_log()
    force = force[::-1].copy()  # contact-free at the end
    spoiled = force.copy()
    spoiled[9000:] += [0.08, 0.05, 0.0]
    found, tare, _ = found_in(stamps, spoiled, (17.2, 19.9))
    assert [finding.kind for finding in found.findings] == ["step of the zero"]
    np.testing.assert_allclose(
        found.corrected(stamps, spoiled) - tare.force_n, force - BIAS_N, atol=0.01
    )  # fmt: skip


def test_without_contact_free_moments_behind_a_step_the_readings_there_are_not_used() -> None:
    stamps, force = bench_log()
    force[8000:] += 0.1 * np.array([0.3, -0.1, 0.01]) / 0.3  # the tip does not leave the wall any more
    force[12_000:] += [0.2, 0.1, 0.0]
    found, _, _ = found_in(stamps, force)
    (finding,) = [each for each in found.findings if each.start_s > 10.0]
    assert finding.readings == 8000
    assert "tare=(START, END)" in finding.detail
    assert np.flatnonzero(~found.usable(stamps)).tolist() == list(range(12_000, 20_000))


def test_a_contact_that_begins_with_a_jump_is_no_step_of_the_zero() -> None:
    stamps, force = bench_log()
    held = force.copy()
    held[10_000:14_000] = BIAS_N + np.array([0.25, 0.0, 0.0])
    held[10_000:14_000] += 3e-3 * np.random.default_rng(0).standard_normal((4000, 3))
    assert not find_zero_steps(stamps, held, BIAS_N)


def test_drift_of_the_zero_is_measured_in_contact_free_moments_and_corrected() -> None:
    stamps, force = bench_log(60.0)
    drifting = force + np.outer(stamps * 1e-9 / 60.0, [0.08, -0.06, 0.0])
    found, tare, _ = found_in(stamps, drifting)
    (finding,) = found.findings
    assert finding.kind == "drift"
    assert finding.size_n == pytest.approx(0.1, abs=0.01)
    assert "mN a minute and is corrected" in finding.detail
    left = found.corrected(stamps, drifting) - tare.force_n - (force - BIAS_N)
    assert np.abs(left).max() < 0.01
    assert ForcePlausibility.of(found.record()).record() == found.record()


def test_usual_drift_is_not_named() -> None:
    stamps, force = bench_log(60.0)
    found, _, _ = found_in(stamps, force + np.outer(stamps * 1e-9 / 60.0, [2e-3, -2e-3, 2e-3]))
    assert not found.findings
