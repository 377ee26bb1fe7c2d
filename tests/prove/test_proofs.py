"""The slow proofs, run by `make prove`: the scripts of bench/ as a person runs them, held to their targets."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow


def run(script: str, *options: str) -> str:
    """What a script of bench/ prints; its failure is the test's."""
    command = [sys.executable, "-m", f"bench.{script}", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_a_thousand_tubes_are_found_within_hundredths_of_a_pixel(tmp_path: Path) -> None:
    figures = tmp_path / "accuracy.json"
    run("studies.vision_accuracy", "--frames", "1000", "--hard", "0", "--json", str(figures))
    standard = json.loads(figures.read_text())["standard"]
    assert standard["frames"] == 1000
    assert standard["lost"] == 0
    assert standard["wrong"] == 0
    assert standard["median_px"] <= 0.07
    assert standard["worst_point_px"] < 0.3
    assert standard["tip_worst_px"] < 1.0


def test_a_kill_costs_a_recording_less_than_a_second_and_an_import_nothing() -> None:
    text = run("studies.kill_recording", "--times", "20")
    worst = re.search(r"worst loss: ([0-9.]+) s", text)
    assert worst is not None
    assert float(worst[1]) < 1.0
    again = re.findall(r"(\d+)/480 frames, (\d+)/20000 readings", text)
    assert again
    assert set(again) == {("480", "20000")}


def test_the_clock_map_is_found_or_refused(tmp_path: Path) -> None:
    figures = tmp_path / "clock.json"
    run("studies.clock_map", str(tmp_path / "sessions"), "--sessions", "3", "--json", str(figures))
    rows = [row for row in json.loads(figures.read_text()) if row["how"] != "refused"]
    assert len(rows) >= 2
    for row in rows:
        assert abs(row["offset_error_ms"]) < 3.0 * row["offset_stderr_ms"]
        assert abs(row["rate_error"]) < 3.0 * row["rate_stderr"]
        assert row["label_rms_mn"] < 10.0


def test_fits_of_the_whole_model_reach_the_bound(tmp_path: Path) -> None:
    figures = tmp_path / "fits.json"
    command = [sys.executable, "-m", "bench.studies.limits_monte_carlo", "--frames", "3", "--draws", "60"]
    command += ["--width", "0.05"]
    subprocess.run([*command, "--json", str(figures)], cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(figures.read_text())
    assert all(row["converged"] >= 50 for row in found["frames"])
    # some 360 squared errors: one standard deviation of their mean is 0.075
    assert 0.8 < found["mean"] < 1.25
