"""Recordings as a dataset: labelled frames, one session a file."""

from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import open_dataset, write_dataset
from tipforce.datasets._recordings import open_recordings
from tipforce.errors import InputError
from tipforce.io import RecordingWriter
from tipforce.types import Actuation, Frame, SessionInfo, Wrench


def write_run(path: Path, session: str, level: int, forces: bool = True, knob_from_ms: int = 0) -> None:
    """One second: 25 frames/s, force in the base frame that starts at 100 ms, grey level = ``level`` + frame."""
    with RecordingWriter(path, SessionInfo(session), lossless=True) as writer:
        for k in range(1000):
            stamp = k * 1_000_000
            if k % 100 == 0 and k >= knob_from_ms:
                writer.write(Actuation(stamp, {"knob_deg": 10.0}))
            if forces and k >= 100:
                writer.write(Wrench(stamp, np.array([k * 1e-3, -0.1, np.nan]), np.full(3, np.nan), "base"))
            if k % 40 == 0:
                writer.write(Frame(stamp, np.full((24, 32), level + k // 40, np.uint8)))


def test_labelled_frames_of_all_files_are_samples(tmp_path: Path) -> None:
    write_run(tmp_path / "a.mcap", "first", 50)
    write_run(tmp_path / "b.mcap", "second", 150)
    data = open_dataset(tmp_path)
    assert data.sessions == ("first", "second")
    assert len(data) == 2 * 22  # frames at 0, 40 and 80 ms lie before the force
    assert data.known.tolist() == [True, True, False]
    assert np.allclose(data.force_n[:22, 0], data.stamp_ns[:22] * 1e-9)
    assert data.names[0] == "a.mcap frame 3"
    levels = [int(o.views["camera"][0, 0]) for o in data.subset(np.array([40, 0, 21])).observations()]  # type: ignore[index]
    assert levels == [150 + 21, 53, 74]
    assert next(data.observations()).actuation == {"knob_deg": 10.0}


def test_one_file_is_a_dataset_too_and_becomes_a_folder(tmp_path: Path) -> None:
    write_run(tmp_path / "a.mcap", "first", 50, knob_from_ms=500)
    data = open_dataset(tmp_path / "a.mcap")
    assert np.isnan(data.actuation["knob_deg"][0])
    assert "knob_deg" not in next(data.observations()).actuation
    folder = open_dataset(write_dataset(data, tmp_path / "folder"))
    assert folder.fingerprint() == data.fingerprint()
    for a, b in zip(data.observations(), folder.observations(), strict=True):
        assert np.array_equal(a.views["camera"], b.views["camera"])  # type: ignore[arg-type]
        assert a.actuation == b.actuation


def test_files_of_the_same_session_name_stay_apart(tmp_path: Path) -> None:
    write_run(tmp_path / "a.mcap", "same", 50)
    write_run(tmp_path / "b.mcap", "same", 50)
    assert open_dataset(tmp_path).sessions == ("same", "same (b)")
    (tmp_path / "later").mkdir()
    write_run(tmp_path / "later/b.mcap", "same", 50)
    three = open_recordings([tmp_path / "a.mcap", tmp_path / "b.mcap", tmp_path / "later/b.mcap"], "three")
    assert three.sessions == ("same", "same (b)", "same (b, 2)")


def test_a_recording_without_forces_names_what_it_has(tmp_path: Path) -> None:
    write_run(tmp_path / "a.mcap", "first", 50, forces=False)
    with pytest.raises(InputError, match=r"a\.mcap: to train on it, a recording needs a stream 'force'; it has"):
        open_dataset(tmp_path)


def test_a_recording_that_was_cut_off_is_recovered_by_either_name_and_said_in_a_folder(tmp_path: Path) -> None:
    write_run(tmp_path / "a.mcap", "first", 50)
    raw = (tmp_path / "a.mcap").read_bytes()
    part = tmp_path / "b.mcap.part"
    part.write_bytes(raw[: len(raw) // 2])
    data = open_dataset(tmp_path)
    assert data.sessions == ("first",)
    assert data.remarks[-1] == "b.mcap.part: is still being written, or was cut off, and is left out"
    for name in ("b.mcap", "b.mcap.part"):
        part.write_bytes(raw[: len(raw) // 2])
        (tmp_path / "b.mcap").unlink(missing_ok=True)
        with pytest.warns(UserWarning, match="recovered"):
            data = open_dataset(tmp_path / name)
        assert len(list(data.observations())) == len(data) > 5
