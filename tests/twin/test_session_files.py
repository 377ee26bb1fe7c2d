import json

import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError
from tipforce.twin.small import SmallBench, SmallBenchSettings, read_truth, simulate, write_session

SETTINGS = SmallBenchSettings(seconds=8, tare_s=3, width=160, height=120, fps=4)


def keep_frames(path, frames, fps):
    """Stands for a video encoder: twin itself knows none."""
    np.save(path.with_suffix(".npy"), np.stack([frame.image for frame in frames]))
    path.with_suffix(".npy").rename(path)


def broken_encoder(path, frames, fps):
    path.write_bytes(b"half")
    next(iter(frames))
    raise OSError("disk full")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("sessions")
    simulate(root, keep_frames, SETTINGS, sessions=2, seed=9, workers=1)
    return root


def test_a_session_folder_holds_what_a_bench_leaves_and_the_truth(root):
    folder = root / "session_01"
    assert sorted(path.name for path in folder.iterdir()) == ["bench.json", "force.csv", "truth.npz", "video.mp4"]
    lines = (folder / "force.csv").read_text().splitlines()
    assert lines[0] == "time_s,fx_n,fy_n,fz_n"
    log = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    np.testing.assert_allclose(log[:, 1:], SmallBench(SETTINGS, 9, 1).force_log().force_n, atol=1e-6)
    assert np.diff(log[:, 0]) == pytest.approx(1e-3)
    assert log[-1, 0] >= 8.08  # beyond the last frame, however far the clocks are apart
    facts = json.loads((folder / "bench.json").read_text())
    assert facts["session"] == "session_01"
    assert facts["reads"] == "tip-on-tissue"
    assert facts["catheter"]["bending_stiffness_nm2"] == 4.3e-4


def test_truth_comes_back_as_it_was(root):
    truth, bench = read_truth(root / "session_00"), SmallBench(SETTINGS, 9, 0)
    again = bench.truth()
    for name in ("stamp_ns", "force_n", "touching", "centreline_m"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(again, name))
    assert truth.base.angle_rad == again.base.angle_rad
    assert (truth.values, truth.metres_per_px, truth.clock_offset_s) == (
        again.values,
        again.metres_per_px,
        again.clock_offset_s,
    )
    assert len(truth.stamp_ns) == bench.frames == 32


def test_the_same_seed_writes_the_same_bytes(root, tmp_path):
    write_session(SmallBench(SETTINGS, 9, 1), tmp_path / "session_01", keep_frames, lambda: None)
    for path in (root / "session_01").iterdir():
        assert path.read_bytes() == (tmp_path / "session_01" / path.name).read_bytes(), path.name


def test_finished_sessions_are_kept_and_half_ones_are_begun_anew(root):
    before = (root / "session_00" / "force.csv").stat().st_mtime_ns
    (root / "session_02.part").mkdir()
    (root / "session_02.part" / "video.mp4").write_bytes(b"half")
    told = []
    folders = simulate(root, keep_frames, SETTINGS, sessions=3, seed=9, progress=lambda what, share: told.append(share))
    assert [folder.name for folder in folders] == ["session_00", "session_01", "session_02"]
    assert (root / "session_00" / "force.csv").stat().st_mtime_ns == before
    assert not (root / "session_02.part").exists()
    assert read_truth(folders[2]).session == "session_02"
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)


def test_a_folder_with_other_sessions_is_not_mixed_with_new_ones(root):
    with pytest.raises(InputError, match=r"session_00: was simulated with fps = 4.0, not 5.0; .* -o"):
        simulate(root, keep_frames, SETTINGS.model_copy(update={"fps": 5.0}), sessions=1, seed=9)
    with pytest.raises(InputError, match="seed = 9, not 8"):
        simulate(root, keep_frames, SETTINGS, sessions=1, seed=8)


def test_a_failure_leaves_no_session_folder(tmp_path):
    with pytest.raises(OSError, match="disk full"):
        write_session(SmallBench(SETTINGS, 9, 0), tmp_path / "session_00", broken_encoder, lambda: None)
    assert not (tmp_path / "session_00").exists()


def test_a_folder_without_or_with_a_damaged_truth_says_so(root, tmp_path):
    with pytest.raises(FileFormatError, match=r"truth\.npz: there is no such file"):
        read_truth(tmp_path)
    whole = (root / "session_00" / "truth.npz").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"nonsense"):
        (tmp_path / "truth.npz").write_bytes(damaged)
        with pytest.raises(FileFormatError, match="no readable truth"):
            read_truth(tmp_path)
