import json

import av
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.twin.small import read_truth

ARGUMENTS = [
    "--preset",
    "demo",
    "--sessions",
    "2",
    "--seconds",
    "8",
    "--set",
    "tare_s=3",
    "--set",
    "width=160",
    "--set",
    "height=120",
]


def run(*arguments):
    return CliRunner().invoke(app, ["simulate", *arguments], catch_exceptions=True)


def test_two_processes_write_sessions_with_videos_whose_stamps_are_true(tmp_path):
    figures = tmp_path / "figures.json"
    result = run("-o", str(tmp_path / "out"), "--json", str(figures), *ARGUMENTS)
    assert result.exit_code == 0, result.output
    assert json.loads(figures.read_text())["frames"] == 384
    truth = read_truth(tmp_path / "out" / "session_00")
    with av.open(str(tmp_path / "out" / "session_00" / "video.mp4")) as video:
        stamps = [frame.time for frame in video.decode(video=0)]
    assert stamps == pytest.approx((truth.stamp_ns * 1e-9).tolist(), abs=1e-4)


def test_an_unknown_bench_is_refused_with_those_there_are(tmp_path):
    result = run("-o", str(tmp_path / "out"), "--preset", "nonsense")
    assert isinstance(result.exception, InputError)
    assert "there are bench-2021, generalise, demo" in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_an_unknown_setting_is_refused_before_anything_is_written(tmp_path):
    result = run("-o", str(tmp_path / "out"), "--preset", "demo", "--set", "frictoin=0.1")
    assert isinstance(result.exception, InputError)
    assert "friction" in str(result.exception)
    assert not (tmp_path / "out").exists()
