import numpy as np
import pytest

from tipforce.alignment import ForceCorrections, StageMotion, changing_tare, contact_free_stretch, pulling_force
from tipforce.io import Inertia, Tare
from tipforce.types import BasePose, CentrelinePx, DetectedShape, SensorInfo, Status

STAMPS = np.arange(20_000) * 1_000_000
SECONDS = STAMPS * 1e-9
BIAS_N = np.array([0.1, -0.05, np.nan])
STILL = StageMotion(np.empty(0, np.int64), {})
FRAMES = np.arange(480) * 41_666_667
STRAIGHT = DetectedShape(
    Status.VALID,
    centreline=CentrelinePx(np.column_stack([np.linspace(10.0, 110.0, 30), np.full(30, 50.0)])),
    base=BasePose(np.array([10.0, 50.0]), 0.0),
)


def readings(direction: tuple[float, float], free_until_s: float = 4.0) -> np.ndarray:
    """(20000, 3): beats of 0.3 N along ``direction`` after the first seconds, which are free."""
    beat = 0.3 * np.maximum(0.0, np.sin(2 * np.pi * 1.2 * SECONDS))
    force = np.outer(np.where(free_until_s > SECONDS, 0.0, beat), [*direction, 0.0]) + BIAS_N
    return force + 3e-3 * np.random.default_rng(0).standard_normal(force.shape)


def tare_of(force: np.ndarray, start_s: float, end_s: float) -> Tare:
    inside = (start_s <= SECONDS) & (end_s >= SECONDS)
    return Tare(np.nan_to_num(force[inside].mean(axis=0)), stretches_s=((start_s, end_s),), how="stated")


def test_a_force_that_changes_in_the_tare_as_elsewhere_is_contact() -> None:
    force = readings((1.0, 0.0))
    found = changing_tare(STAMPS, force, STILL, tare_of(force, 8.0, 12.0), Inertia(), None)
    assert found is not None
    assert (found.kind, found.start_s, found.end_s) == ("contact during tare", 8.0, 12.0)
    assert found.size_n == pytest.approx(0.3, abs=0.02)
    assert changing_tare(STAMPS, force, STILL, tare_of(force, 0.0, 4.0), Inertia(), None) is None
    assert contact_free_stretch(STAMPS, force, STILL, None) == (0.0, 2.0)


def test_a_moving_sensor_without_a_log_of_its_stage_is_not_judged() -> None:
    force = readings((1.0, 0.0))
    assert changing_tare(STAMPS, force, STILL, tare_of(force, 8.0, 12.0), Inertia(), 0.05) is None


def test_a_mass_far_above_the_stated_one_is_contact() -> None:
    position = {"forward_mm": 5.0 * np.sin(2 * np.pi * 1.2 * SECONDS[::10])}
    stage = StageMotion(STAMPS[::10], position)
    carried = stage.acceleration(STAMPS, stage.names) @ np.array([[0.2, 0.0, 0.0]])
    force = readings((0.0, 1.0)) + carried
    inertia = Inertia(stage.names, np.array([[0.2, 0.0, 0.0]]), 0, "estimated")
    tare = tare_of(force, 0.0, 4.0)
    found = changing_tare(STAMPS, force, stage, tare, inertia, 0.05)
    assert found is not None
    assert "as if it carried 200 g, and sensor.moving_mass_kg states 50 g" in found.detail
    assert changing_tare(STAMPS, force, stage, tare, inertia, 0.19) is None


@pytest.mark.parametrize("pressed_n", [0.0, 0.5])
def test_a_tare_under_a_force_along_the_tip_makes_the_tissue_pull(pressed_n: float) -> None:
    force = readings((1.0, 0.0))  # tip on tissue: along the tip's axis
    force[SECONDS < 3.5, 0] += pressed_n
    facts = ForceCorrections(SensorInfo(0.0, "tip-on-tissue"), tare_of(force, 0.0, 3.0), Inertia(), STILL)
    found = pulling_force(FRAMES, [STRAIGHT] * len(FRAMES), STAMPS, force, facts)
    if pressed_n:
        assert found is not None
        assert found.size_n == pytest.approx(0.5, abs=0.02)
        assert "would pull at the tip with up to 0.50 N" in found.detail
    else:
        assert found is None


def test_a_sensor_that_is_read_the_wrong_way_round_is_not_taken_for_a_tare_in_contact() -> None:
    force = readings((1.0, 0.0))
    facts = ForceCorrections(SensorInfo(180.0, "tip-on-tissue"), tare_of(force, 0.0, 3.0), Inertia(), STILL)
    assert pulling_force(FRAMES, [STRAIGHT] * len(FRAMES), STAMPS, force, facts) is None
