"""Many sessions as files: what stands is kept, what failed leaves nothing, other settings do not mix."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tipforce._system.executor import LocalExecutor
from tipforce.errors import InputError
from tipforce.simulation import (
    SimulatedBench,
    SimulationSettings,
    collect_truth,
    read_truth,
    simulate,
    truth_path,
    write_logs,
)
from tipforce.types import read_bench


def leave(bench, target, tick):
    """Stands for what writes images: the simulation itself writes no video."""
    part = target.with_name("part")
    part.mkdir()
    for index in range(0, len(bench.frame_s), 40):
        np.save(part / f"{index:03d}.npy", bench.frame(index).image)
        tick()
    write_logs(bench, part)
    part.rename(target)


def fail(bench, target, tick):
    tick()
    raise OSError("disk full")


@pytest.fixture(scope="module")
def root(short, tmp_path_factory):
    root = tmp_path_factory.mktemp("sessions")
    simulate(root, leave, short, suffix="", sessions=2, seed=21, executor=LocalExecutor(1))
    return root


def table(path):
    names, *rows = path.read_text().splitlines()
    return names, np.array([[float(cell) for cell in row.split(",")] for row in rows])


def test_logs_hold_what_the_bench_read_and_the_metadata_nothing_of_the_truth(root, bench):
    folder = root / "session_01"
    assert {path.name for path in root.iterdir()} >= {"session_01", "session_01.truth.npz"}
    assert {path.name for path in folder.iterdir() if path.suffix != ".npy"} == {"bench.toml", "force.csv", "stage.csv"}
    names, rows = table(folder / "force.csv")
    assert names == "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
    np.testing.assert_allclose(rows[:, 0], bench.log.stamp_ns * 1e-9, atol=1e-9)
    np.testing.assert_allclose(rows[:, 1:4], bench.log.force_n, atol=1e-6)
    np.testing.assert_allclose(rows[:, 4:], bench.log.torque_nm, atol=1e-8)
    stamps, stage = bench.stage_log()
    names, rows = table(folder / "stage.csv")
    assert names == "time_s,stage_forward_mm,stage_across_mm"
    np.testing.assert_allclose(rows, np.column_stack([stamps * 1e-9, *stage.values()]), atol=1e-4)
    stated = read_bench(folder / "bench.toml")
    constant = replace(bench.session_info.actuation, constant={"knob_deg": 10.0})
    assert stated == replace(bench.session_info, name="", actuation=constant)
    assert (stated.sensor.reads, stated.sensor.no_contact_s) == ("tip-on-tissue", (0.0, 2.0))
    assert stated.catheter.bending_stiffness_nm2 == 4.3e-4
    stated = (folder / "bench.toml").read_text()
    truth = collect_truth(bench).values
    for name in ("flexible_length_m", "stiffness_nm2", "friction", "contact_angle_deg", "knob_factor", "amplitude_m"):
        assert f"{truth[name]:.4g}" not in stated, name


def test_a_knob_that_moves_has_a_log_of_its_own(short, tmp_path):
    actuation = short.world.actuation.model_copy(update={"knob_deg": (0.0, 20.0), "knob_deg_per_s": 8.0})
    moving = short.model_copy(update={"world": short.world.model_copy(update={"actuation": actuation})})
    bench = SimulatedBench(moving, seed=21, session=1)
    write_logs(bench, tmp_path)
    names, rows = table(tmp_path / "knob.csv")
    stamps, knob = bench.knob_log()
    assert names == "time_s,knob_deg"
    np.testing.assert_allclose(rows, np.column_stack([stamps * 1e-9, knob]), atol=1e-4)
    assert np.ptp(rows[:, 1]) > 1.0
    assert not read_bench(tmp_path / "bench.toml").actuation.constant


def test_truth_comes_back_as_it_was(root, bench):
    truth, again = read_truth(root / "session_01"), collect_truth(bench)
    for name in ("stamp_ns", "force_n", "touching", "centreline_m", "centreline_px", "mask_bytes"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(again, name))
    assert (truth.values, truth.clock_offset_s, truth.clock_drift) == (
        json.loads(json.dumps(again.values)),
        again.clock_offset_s,
        again.clock_drift,
    )
    assert len(truth.stamp_ns) == len(bench.frame_s)


def test_the_same_seed_writes_the_same_bytes(root, short, tmp_path):
    simulate(tmp_path, leave, short, suffix="", sessions=1, seed=21, executor=LocalExecutor(1))
    for path in sorted((root / "session_00").iterdir()):
        assert path.read_bytes() == (tmp_path / "session_00" / path.name).read_bytes(), path.name


def test_finished_sessions_are_kept_and_others_added(root, short):
    before = (root / "session_00" / "force.csv").stat().st_mtime_ns
    shares = []
    places = simulate(
        root, leave, short, suffix="", sessions=3, seed=21, progress=lambda what, share: shares.append(share)
    )
    assert [place.name for place in places] == ["session_00", "session_01", "session_02"]
    assert (root / "session_00" / "force.csv").stat().st_mtime_ns == before
    assert read_truth(places[2]).session == "session_02"
    assert shares == sorted(shares)


def test_a_folder_with_other_sessions_is_not_mixed_with_new_ones(root, short):
    with pytest.raises(InputError, match=r"session_00: was simulated with width = 160, not 200; .* -o"):
        simulate(root, leave, short.model_copy(update={"width": 200}), suffix="", sessions=1, seed=21)
    with pytest.raises(InputError, match="seed = 21, not 8"):
        simulate(root, leave, short, suffix="", sessions=1, seed=8)


def test_a_failure_leaves_no_session(short, tmp_path):
    with pytest.raises(OSError, match="disk full"):
        simulate(tmp_path, fail, short, suffix="", sessions=1, seed=21)
    assert not (tmp_path / "session_00").exists()
    simulate(tmp_path, leave, short, suffix="", sessions=1, seed=21)
    assert (tmp_path / "session_00" / "force.csv").is_file()
    assert truth_path(tmp_path / "session_00").is_file()


def test_settings_of_a_preset_are_checked():
    with pytest.raises(ValueError, match="greater than or equal to 160"):
        SimulationSettings(width=100)
