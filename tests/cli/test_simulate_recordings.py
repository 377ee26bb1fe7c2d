"""``tipforce simulate``: recordings as a bench leaves them, the truth beside them."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.alignment import StageMotion, labels
from tipforce.cli import app
from tipforce.errors import FileFormatError, InputError
from tipforce.io import RecordingReader
from tipforce.simulation import read_truth, truth_path

SMALL = ["--set", "width=320", "--set", "height=240", "--set", "world.motion.peak_within_n=0.005"]
ARGUMENTS = ["--sessions", "2", "--seconds", "9", "--set", "world.tare_s=2", "--seed", "4", *SMALL]


def run(*arguments):
    return CliRunner().invoke(app, ["simulate", *arguments], catch_exceptions=True)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    root = tmp_path_factory.mktemp("simulated") / "runs"
    result = run("-o", str(root), "--json", str(root.parent / "figures.json"), *ARGUMENTS)
    assert result.exit_code == 0, result.output
    return root


def test_a_recording_holds_what_a_bench_has_and_nothing_of_the_truth(runs):
    assert sorted(path.name for path in runs.iterdir()) == [
        "session_00.mcap",
        "session_00.truth.npz",
        "session_01.mcap",
        "session_01.truth.npz",
    ]
    with RecordingReader(runs / "session_01.mcap") as reader:
        info, session = reader.info, reader.session_info
        assert set(info.streams) == {"camera", "force", "joints", "stage"}
        assert info.streams["force"].rate_hz == pytest.approx(1000, rel=1e-3)
        assert info.streams["camera"].rate_hz == pytest.approx(24, rel=1e-2)
        assert info.inertia.how == "estimated"
        assert (session.catheter.flexible_length_m, session.catheter.bending_stiffness_nm2) == (0.04, 4.3e-4)
        assert session.preset == "bench-2021 changed"
        stated = json.dumps({name: dict(record) for name, record in info.metadata.items()})
    truth = read_truth(runs / "session_01.mcap")
    for name in ("flexible_length_m", "stiffness_nm2", "friction", "contact_angle_deg", "knob_factor", "amplitude_m"):
        assert name in truth.values
        assert f"{truth.values[name]:.4g}" not in stated, name


def test_labels_are_the_true_force_but_for_the_sensors_own_errors(runs):
    for path in sorted(runs.glob("*.mcap")):
        truth = read_truth(path)
        with RecordingReader(path) as reader:
            found = labels(reader)
            offset = reader.info.clock_map
        assert offset.how == "estimated", offset.detail
        # the offset at the middle of the log; 20 ppm are nothing in 9 s
        assert offset.offset_ms == pytest.approx(1e3 * truth.clock_offset_s, abs=3.0)
        np.testing.assert_array_equal(found.stamp_ns, truth.stamp_ns)
        known = np.isfinite(found.force_n).all(axis=1)
        miss = found.force_n[known] - truth.force_n[known]
        assert np.sqrt((miss[:, :2] ** 2).mean()) < 8e-3
        assert np.abs(np.median(miss, axis=0)).max() < 6e-3


def test_truth_of_shape_and_mask_fits_the_image(runs):
    path = runs / "session_00.mcap"
    truth = read_truth(path)
    with RecordingReader(path) as reader:
        for index in (100, 200):
            grey = reader.frame_at(index).image.mean(axis=2)
            mask = truth.mask(index)
            assert mask.shape == grey.shape
            around = np.zeros_like(mask)
            line = np.rint(truth.centreline_px[index]).astype(int)
            inside = (line[:, 0] >= 0) & (line[:, 0] < mask.shape[1])
            assert mask[line[inside][:-8, 1], line[inside][:-8, 0]].mean() > 0.97
            rows, columns = np.nonzero(mask)
            around[rows.min() : rows.max(), columns.min() : columns.max()] = True
            assert grey[mask].mean() < grey[around & ~mask].mean() - 20
    steps = np.linalg.norm(np.diff(truth.centreline_m, axis=1), axis=2)
    np.testing.assert_allclose(steps, steps[0, 0], rtol=5e-3)


def test_the_truth_in_the_sensors_frame_is_what_the_sensor_reads(runs):
    truth = read_truth(runs / "session_00.mcap")
    with RecordingReader(runs / "session_00.mcap") as reader:
        stamps, readings, _ = reader.wrenches()
        carried = StageMotion.of(reader.stage_readings()).acceleration(
            stamps + reader.info.inertia.lag_ns, reader.info.inertia.axes
        )
        readings = readings - carried @ reader.info.inertia.gain_kg
    own = np.interp(truth.stamp_ns, stamps + 1e9 * truth.clock_offset_s, np.arange(len(stamps)))
    mean = np.array([readings[max(0, int(k) - 5) : int(k) + 6].mean(axis=0) for k in own])
    inside = (own > 6) & (own < len(stamps) - 7) & np.isfinite(mean).all(axis=1)
    of_tip_n = -truth.sensor_from_base.rotate(truth.force_n)
    miss = (mean - of_tip_n)[inside]
    assert np.abs(of_tip_n).max() > 0.05
    assert miss.std(axis=0).max() < 8e-3  # what is left in the mean is the bias


@pytest.mark.slow
def test_the_same_seed_is_the_same_bytes_and_finished_sessions_are_kept(runs, tmp_path):
    before = (runs / "session_00.mcap").stat().st_mtime_ns
    assert run("-o", str(runs), *ARGUMENTS).exit_code == 0
    assert (runs / "session_00.mcap").stat().st_mtime_ns == before
    assert run("-o", str(tmp_path), *ARGUMENTS[2:], "--sessions", "1").exit_code == 0
    for name in ("session_00.mcap", "session_00.truth.npz"):
        assert (tmp_path / name).read_bytes() == (runs / name).read_bytes(), name


def test_other_settings_do_not_mix_with_what_is_there(runs):
    result = run("-o", str(runs), *ARGUMENTS, "--set", "world.wall.friction=[0,0]")
    assert isinstance(result.exception, InputError)
    assert "was simulated with another world" in str(result.exception)


def test_a_lost_or_damaged_truth_says_so(runs, tmp_path):
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_truth(tmp_path / "session_00.mcap")
    whole = truth_path(runs / "session_00.mcap").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"nonsense"):
        (tmp_path / "a.truth.npz").write_bytes(damaged)
        with pytest.raises(FileFormatError, match="no readable"):
            read_truth(tmp_path / "a.mcap")


def test_an_unknown_setting_is_refused_before_anything_is_written(tmp_path):
    result = run("-o", str(tmp_path / "out"), "--set", "world.wall.frictoin=0.1")
    assert isinstance(result.exception, InputError)
    assert "frictoin" in str(result.exception)
    assert not (tmp_path / "out").exists()
