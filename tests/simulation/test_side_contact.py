"""The option that the shaft's side touches the moving wall too."""

import numpy as np
import pytest

from tipforce.simulation import LiveSimulation, SimulationSettings, read_truth, write_truth

SETTINGS = SimulationSettings.model_validate(
    {
        "world": {
            "seconds": 8.0,
            "tare_s": 1.0,
            "wall": {"contact_angle_deg": [60, 60], "side_stiffness_n_per_m2": 1e4},
            "motion": {"peak_force_n": [0.03, 0.08], "free_share": [0.0, 0.9], "peak_within_n": 5e-3},
            "sensor": {"noise_n": 0.0, "torque_noise_nm": 0.0, "step_n": [1e-9] * 3, "torque_step_nm": 1e-12},
            "clock": {"fps": 6.0},
        },
        "width": 160,
        "height": 120,
    }
)


@pytest.fixture(scope="module")
def source():
    """The tissue is pushed so far that the shaft lies down on it."""
    simulation = LiveSimulation(SETTINGS, seed=4, images=False)
    with simulation as bench:
        for _ in bench.source:
            now = bench.clock.now_ns() * 1e-9
            if now > 1.5:
                bench.actuators.command({"stage_forward_mm": 12.0 * (now - 1.5), "stage_across_mm": 0.0})
            if now > 3.5:
                break
        bench.source.kept_truth = bench.truth()
        yield bench.source


def test_side_and_dome_push_away_from_the_wall_and_the_clamp_carries_both(source):
    done, trajectory = source.run.done, source.trajectory
    contact, normal = trajectory.contact, np.asarray(source.session.bench_model.wall.normal)
    side = -contact.side_force_n[:done] @ normal
    assert side.max() > 0.02
    assert side.min() >= 0.0
    assert not side[trajectory.time_s[:done] < 1.0].any()
    assert contact.converged[:done].all()
    np.testing.assert_allclose(contact.reaction_force_n, -contact.force_n - contact.side_force_n, atol=1e-12)
    depth = (
        contact.nodes_m()[:done, 1:-1] - trajectory.wall_m[:done, None]
    ) @ normal + source.session.bench_model.radius_m
    spring = 1e4 * contact.rod.flexible_length_m / contact.rod.segments  # of each node
    np.testing.assert_allclose(side, spring * np.maximum(depth, 0.0).sum(axis=1), atol=1e-7)


def test_the_sensor_reads_both_and_the_truth_tells_them_apart(source, tmp_path):
    log, trajectory = source.log, source.trajectory
    rows = slice(0, int(np.searchsorted(source.readings.need_force, source.run.final)))

    def at(values):
        return np.stack([np.interp(log.true_s[rows], trajectory.time_s, values[:, k]) for k in range(3)], axis=1)

    own = log.bias_n + log.drift_n_per_s * log.true_s[rows, None]
    base = (log.force_n[rows] - own) @ log.rotation
    base -= 0.05 * (np.array([0.0, 0.0, -9.80665]) - at(trajectory.acceleration_m_per_s2))
    np.testing.assert_allclose(base, -at(trajectory.contact.force_n + trajectory.contact.side_force_n), atol=1e-6)
    origin = trajectory.wall_m + 0.02 * source.session.bench_model.forward
    moment = np.cross(trajectory.contact.touch_m - origin, -trajectory.contact.force_n)
    moment += np.cross(trajectory.side_touch_m(slice(None)) - origin, -trajectory.contact.side_force_n)
    np.testing.assert_allclose(log.torque_nm[rows] @ log.rotation, at(moment), atol=1e-5)
    truth = source.kept_truth
    assert np.linalg.norm(truth.side_force_n, axis=1).max() > 0.02
    assert truth.side_force_n.shape == truth.force_n.shape
    write_truth(truth, tmp_path / "one.truth.npz")
    np.testing.assert_array_equal(read_truth(tmp_path / "one.truth.npz").side_force_n, truth.side_force_n)
