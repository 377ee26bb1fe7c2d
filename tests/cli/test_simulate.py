"""``tipforce simulate --as files``: what a laboratory's machines leave, and the way from there to a recording."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.alignment import labels
from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.io import RecordingReader, open_source
from tipforce.simulation import read_truth
from tipforce.types import Frame, read_bench

SMALL = ["width=320", "height=240", "world.tare_s=2", "world.motion.peak_within_n=0.005"]
SETTINGS = ["--sessions", "1", "--seconds", "12", "--seed", "3", *(word for each in SMALL for word in ("--set", each))]


def run(verb, *arguments):
    return CliRunner().invoke(app, [verb, *map(str, arguments)], catch_exceptions=True)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    root = tmp_path_factory.mktemp("files")
    result = run("simulate", "--as", "files", "-o", root, "--json", root / "figures.json", *SETTINGS)
    assert result.exit_code == 0, result.output
    assert json.loads((root / "figures.json").read_text())["sessions"] == ["session_00"]
    return root / "session_00"


def test_a_session_is_a_video_with_true_stamps_and_logs(session):
    names = sorted(path.name for path in session.iterdir())
    assert names == ["bench.toml", "force.csv", "stage.csv", "video.mp4"]
    with open_source(session / "video.mp4") as source:
        stamps = [event.stamp_ns for event in source if isinstance(event, Frame)]
    truth = read_truth(session)
    assert stamps[0] > 0, "the first frame is not the zero of the clock that stage and knob are stamped by"
    np.testing.assert_allclose(stamps, truth.stamp_ns, rtol=0, atol=1e9 / 90_000)


def test_imported_the_files_give_the_true_force_but_for_the_sensors_own_errors(session, tmp_path):
    result = run(
        "import", session / "video.mp4", session / "stage.csv", session / "force.csv",
        "--bench", session / "bench.toml", "-o", tmp_path / "run.mcap",
    )  # fmt: skip
    assert result.exit_code == 0, result.exception
    truth = read_truth(session)
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found, info, stated = labels(reader), reader.info, reader.session_info
    assert stated == replace(read_bench(session / "bench.toml"), name="run")
    assert info.tare.how == "stated"
    assert info.clock_map.how == "estimated"
    assert info.clock_map.offset_ms == pytest.approx(1e3 * truth.clock_offset_s, abs=3.0)
    assert info.inertia.how == "estimated"
    known = np.isfinite(found.force_n).all(axis=1)
    miss = found.force_n[known] - truth.force_n[known]
    assert known.mean() > 0.95
    assert np.sqrt((miss[:, :2] ** 2).mean()) < 8e-3


def test_lossless_files_hold_every_pixel_that_is_drawn(tmp_path):
    from tipforce.simulation import PRESETS, SimulatedBench, SimulationSettings

    small = ["width=160", "height=120", "world.clock.fps=4", "world.tare_s=2", "world.motion.peak_within_n=0.005"]
    settings = [word for pair in small for word in ("--set", pair)]
    result = run(
        "simulate", "--as", "files", "--lossless", "--sessions", "1", "--seconds", "8", "-o", tmp_path, *settings
    )
    assert result.exit_code == 0, result.exception
    chosen = SimulationSettings.model_validate(
        read_truth(tmp_path / "session_00").settings | {}, strict=False, extra="ignore"
    )
    assert chosen.preset == "bench-2021 changed"
    assert chosen.world != PRESETS["bench-2021"].world
    bench = SimulatedBench(chosen)
    with open_source(tmp_path / "session_00" / "video.mp4") as source:
        for index, event in enumerate(event for event in source if isinstance(event, Frame)):
            np.testing.assert_array_equal(event.image, bench.frame(index).image)
    assert index == len(bench.frame_s) - 1


def test_an_unknown_bench_is_refused_with_those_there_are(tmp_path):
    result = run("simulate", "-o", tmp_path / "out", "--preset", "nonsense")
    assert isinstance(result.exception, InputError)
    assert "there are bench-2021, generalise" in str(result.exception)
    assert not (tmp_path / "out").exists()
